"""The scenario that is best in one way, with what theory says of it; docs/theory.md derives it."""

from typing import Any, Literal, cast, get_args

from nrs_cosim.api.scenario import Scenario, experiment_of
from nrs_cosim.api.theory import Theory
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.orchestrator.analysis import designs
from nrs_cosim.orchestrator.analysis.plant_samples import Sampling

Goal = Literal["fastest", "period", "jitter", "pinning", "accuracy"]


class Design:
    """What was found, the scenario that has it, and what theory says of that."""

    __slots__ = ("_found", "scenario")

    def __init__(self, found: designs.ScenarioDesign, scenario: Scenario) -> None:
        self._found = found
        self.scenario: Scenario = scenario.replace(found.changes) if found.changes else scenario
        """With what was found; as it was where nothing was."""

    @property
    def goal(self) -> Goal:
        """What it is best for."""
        return cast(Goal, self._found.goal)

    @property
    def values(self) -> dict[str, Any]:
        """What was found, by name."""
        return dict(self._found.values)

    @property
    def theory(self) -> Theory:
        """What theory says of the scenario with it."""
        return Theory(self.scenario)

    def __repr__(self) -> str:
        """Return what was found, on a line."""
        return f"Design({'; '.join(f'{name}: {row}' for name, row in self._found.rows.items())})"


def design(
    scenario: Scenario,
    goal: Goal,
    *,
    robots: int | None = None,
    position: float | None = None,
    velocity: float | None = None,
    share: float = 0.5,
) -> Design:
    """Return the scenario that is best in one way.

    Args:
        scenario: What is to be changed.
        goal: `fastest` gains alpha and beta; the longest `period` that converges; the largest
            `jitter` under which convergence is proven; `pinning`, the robots that
            should receive from the target; or gains and a period for an `accuracy` that is proven.
        robots: Of `pinning`, how many.
        position: Of `accuracy`, the largest ‖q − ε_0‖₂ in steady state, rad.
        velocity: Of `accuracy`, the largest ‖q̇ − υ_0‖₂, rad/s.
        share: Of `accuracy`, the part that a robot may be off its own estimate, above 0 and below
            1; the rest is for the error of that estimate.

    Raises:
        InputError: Nothing of that kind is known of the scenario, or an argument is wrong.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> fastest = nrs.design(scenario, "fastest")
        >>> fastest.scenario["algorithm.alpha"], round(fastest.theory.spectral_radius, 4)
        (1.0, 0.7071)
    """
    experiment = experiment_of(scenario)
    match goal:
        case "fastest":
            found = designs.fastest(experiment)
        case "period":
            found = designs.longest_period(experiment)
        case "jitter":
            found = designs.largest_jitter(experiment)
        case "pinning":
            if not isinstance(robots, int) or robots < 1:
                raise InputError(f"robots: expected how many to pin, got {quoted(robots)}")
            found = designs.best_pinning(experiment, robots)
        case "accuracy":
            wanted = [
                _above_0(name, value)
                for name, value in (("position", position), ("velocity", velocity))
            ]
            if not 0 < share < 1:
                raise InputError(f"share: expected a number between 0 and 1, got {quoted(share)}")
            find = Sampling(experiment)
            found = designs.accurate(experiment, EstimateBounds(*wanted), share, find)
        case _:
            goals = ", ".join(get_args(Goal))
            raise InputError(f"goal: expected one of {goals}, got {quoted(goal)}")
    return Design(found, scenario)


def _above_0(name: str, value: float | None) -> float:
    if value is None or not 0 < value < float("inf"):
        raise InputError(f"{name}: expected a number above 0, got {quoted(value)}")
    return value
