"""What the theory says of a scenario before it runs, as `nrs check` shows it."""

from typing import Any

from nrs_cosim.api.scenario import Scenario, experiment_of
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.orchestrator.analysis.bounds import Bound, bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.conditions import check as check_experiment
from nrs_cosim.orchestrator.analysis.plant_samples import Sampling


class Theory:
    """Conditions, convergence and bounds of a scenario; docs/theory.md derives each."""

    __slots__ = ("_bounds_of_run", "_checked", "bounds")

    def __init__(self, scenario: Scenario) -> None:
        experiment = experiment_of(scenario)
        find = Sampling(experiment)
        self._checked = check_experiment(experiment, find)
        self._bounds_of_run = ultimate_bounds(experiment, self._checked.rho, find)
        self.bounds: tuple[Bound, ...] = tuple(bounds(self._bounds_of_run))
        """What estimation and tracking errors come to in the long run, by quantity."""

    @property
    def spectral_radius(self) -> float:
        """ρ of the estimation error's recursion: it converges if and only if ρ < 1."""
        return self._checked.spectral_radius

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The algorithm's and the controller's, each with its value, bound and margin."""
        return self._checked.conditions

    @property
    def warnings(self) -> list[str]:
        """A line for each condition that does not hold, and for estimates that do not converge."""
        return self._checked.warnings()

    def as_json(self) -> dict[str, Any]:
        """Return all of it, as `nrs check --json` prints it."""
        return {**self._checked.as_json(), **self._bounds_of_run.as_json()}

    def __repr__(self) -> str:
        """Return whether all conditions hold, and the spectral radius."""
        broken = [condition.name for condition in self.conditions if not condition.holds]
        kept = f"violated: {', '.join(broken)}" if broken else "all conditions hold"
        if self._checked.premise:
            kept += f", of {self._checked.premise}"
        return f"Theory(spectral radius {self.spectral_radius:.6g}, {kept})"


def check(scenario: Scenario) -> Theory:
    """Return what the theory says of a scenario, without running it.

    Third-party FMUs are loaded, in a process of their own, where the bounds of their mechanics have
    to be sampled; what cannot be known of them is said to be unknown.

    Args:
        scenario: What would run.

    Raises:
        InputError: The algorithm is not installed, or does not work.

    Example:
        >>> import nrs_cosim as nrs
        >>> theory = nrs.check(nrs.Scenario.load("scenarios/paper_first_order.toml"))
        >>> theory
        Theory(spectral radius 0.877817, all conditions hold)
        >>> [condition.name for condition in theory.conditions][:2]
        ['alpha', 'beta']
    """
    return Theory(scenario)
