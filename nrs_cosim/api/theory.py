"""What the theory says of a scenario before it runs, as `nrs check` shows it."""

from math import isnan
from typing import Any, Literal

from nrs_cosim.api.scenario import Scenario, experiment_of
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.orchestrator.analysis.bounds import Bound, bounds, ultimate_bounds
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
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
        self._bounds_of_run = ultimate_bounds(experiment, self._checked.links.radius, find)
        self.bounds: tuple[Bound, ...] = tuple(bounds(self._bounds_of_run))
        """What estimation and tracking errors come to in steady state, by quantity."""

    @property
    def convergence(self) -> Literal["converges", "diverges", "unknown"]:
        """Whether the estimates converge over the links that the scenario has, as far as proven."""
        return self._checked.convergence

    @property
    def spectral_radius(self) -> float:
        """ρ of the estimation error's recursion over the links that the scenario has.

        Over links that are late by fixed times, or without faults, the estimates converge if and
        only if ρ < 1. Where samples are lost it is of the root of the mean square of errors: they
        converge in mean square if and only if it is below 1. Where delays or sampling times are
        drawn ρ lies between `spectral_radius_bounds`, and is not a number unless these are one;
        nor is it where robots lie, or nothing is known.

        Example:
            >>> import nrs_cosim as nrs
            >>> slow = nrs.Scenario.load("scenarios/paper_example_3a.toml").replace(
            ...     {"run.sampling_period": 0.4, "run.output_step": 0.4}
            ... )
            >>> late = nrs.check(slow.replace({"faults.links": [{"delay": 1}]}))
            >>> late
            Theory(diverges, spectral radius 1.01178; of links without faults: all conditions hold)
            >>> round(late.spectral_radius_without_faults, 4), late.warnings[0][:38]
            (0.8901, 'over these links the estimates diverge')
        """
        return self._checked.spectral_radius

    @property
    def spectral_radius_bounds(self) -> tuple[float, float]:
        """Between what ρ lies over the links that the scenario has; not numbers if not known."""
        radius = self._checked.links.radius
        return radius.lower, radius.upper

    @property
    def spectral_radius_without_faults(self) -> float:
        """ρ if no link had a fault and no robot lied, which the conditions are of as well."""
        return self._checked.rho.radius

    @property
    def conditions(self) -> tuple[Condition, ...]:
        """The algorithm's and the controller's, each with its value, bound and margin."""
        return self._checked.conditions

    @property
    def warnings(self) -> list[str]:
        """A line for each condition that does not hold, and one where convergence is not sure.

        It is not sure where the estimates diverge over the links that there are, and where it is
        not proven that they converge over links with faults.
        """
        return warnings_of(self._checked)

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
        """Return whether the estimates converge and all conditions hold."""
        checked = self._checked
        broken = [condition.name for condition in self.conditions if not condition.holds]
        kept = f"violated: {', '.join(broken)}" if broken else "all conditions hold"
        kept = f"of {checked.premise}: {kept}" if checked.premise else kept
        low, high = self.spectral_radius_bounds
        known = not isnan(self.spectral_radius)
        radius = f"{self.spectral_radius:.6g}" if known else f"{low:.6g} to {high:.6g}"
        number = "" if isnan(high) else f", {checked.links.radius_name} {radius}"
        return f"Theory({self.convergence}{number}; {kept})"


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
        Theory(converges, spectral radius 0.877817; all conditions hold)
        >>> [condition.name for condition in theory.conditions][:2]
        ['alpha', 'beta']
    """
    return Theory(scenario)
