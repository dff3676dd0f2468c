"""What the theory says of a scenario before it runs, as `nrs check` shows it."""

from typing import Any

from nrs_cosim.api.scenario import Scenario, experiment_of
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.orchestrator.analysis.bounds import Bound, bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.conclusion import theory_json
from nrs_cosim.orchestrator.analysis.conditions import check as check_experiment
from nrs_cosim.orchestrator.analysis.plant_samples import Sampling
from nrs_cosim.orchestrator.analysis.worst_scenario import worst_target_changes


class Theory:
    """Conditions, convergence and bounds of a scenario; docs/theory.md derives each."""

    __slots__ = ("_bounds_of_run", "_checked", "_scenario", "bounds")

    def __init__(self, scenario: Scenario) -> None:
        experiment, self._scenario = experiment_of(scenario), scenario
        find = Sampling(experiment)
        self._checked = check_experiment(experiment, find)
        self._bounds_of_run = ultimate_bounds(experiment, self._checked.rho, find)
        self.bounds: tuple[Bound, ...] = tuple(bounds(self._bounds_of_run))
        """What estimation and tracking errors come to in steady state, by quantity."""

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

    def worst_target(self) -> Scenario:
        """Return the scenario with a target that does the worst that any within γ1 and γ2 can.

        On the first axis it attains the worst case of the estimates' positions, on the second that
        of their velocities, at a sampling time near the run's end.

        Raises:
            InputError: The worst case is not computed, or no target is known that attains it.

        Example:
            >>> import nrs_cosim as nrs
            >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
            >>> worst = nrs.check(scenario).worst_target()
            >>> [round(bound.worst_case, 3) for bound in nrs.check(worst).bounds[:2]]
            [0.167, 0.516]
        """
        experiment = experiment_of(self._scenario)
        return self._scenario.replace(worst_target_changes(experiment, self._bounds_of_run))

    def as_json(self) -> dict[str, Any]:
        """Return all of it, as `nrs check --json` prints it."""
        return theory_json(self._checked, self._bounds_of_run)

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
