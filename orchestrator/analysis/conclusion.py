"""What is concluded of a scenario before it runs: whether it converges, how fast, to within what.

It is of the links as they are. The text and the JSON of `nrs check` say it from this one object.
"""

from dataclasses import asdict, dataclass
from math import isnan
from typing import Any, Literal

from nrs_cosim.orchestrator.analysis.bounds import UltimateBounds, pair_json
from nrs_cosim.orchestrator.analysis.conditions import Check, finite
from nrs_cosim.orchestrator.analysis.links import LinkAnalysis, LinkStatus


@dataclass(frozen=True, slots=True)
class Conclusion:
    """What is known of the estimates' convergence."""

    status: LinkStatus
    proven: bool
    """Whether it follows from a statement with a proof, and not from simulation."""
    source: str
    """The statement, or the spectral radius; empty where nothing is known."""
    why_unknown: str
    """Why nothing is known, where it is not."""
    settling_time: float | None
    """s, until any initial error is a millionth of itself at most; None where not known."""
    growth: float | None
    """What errors are multiplied by at a sampling time, at least, where they diverge; or None."""
    growth_at_most: float | None
    """And at most, with 99.9 % confidence where it is by simulation; None where not known."""
    within: dict[str, float | None] | None
    """How near positions and velocities come to the target's in steady state; None if not known."""
    of: Literal["this target", "any target within gamma_1 and gamma_2", ""]
    """What that is of."""

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return asdict(self)


def conclusion(checked: Check, ultimate: UltimateBounds) -> Conclusion:
    """Return what follows from the analysis of one experiment."""
    links = checked.links
    known = links.status != "unknown"
    steady = ultimate.steady_state
    bound = steady or ultimate.worst_case
    return Conclusion(
        status=links.status,
        proven=known and links.proven,
        source=(links.source or _radius(links)) if known else "",
        why_unknown="" if known else _why_unknown(checked),
        settling_time=checked.settling_time,
        growth=finite(links.growth),
        growth_at_most=finite(links.growth_at_most),
        within=pair_json(bound),
        of=""
        if bound is None
        else ("this target" if steady else "any target within gamma_1 and gamma_2"),
    )


def theory_json(checked: Check, ultimate: UltimateBounds) -> dict[str, Any]:
    """Return all that theory says of an experiment for JSON, what is concluded first."""
    said = {"conclusion": conclusion(checked, ultimate).as_json()}
    return {**said, **checked.as_json(), **ultimate.as_json()}


def _radius(links: LinkAnalysis) -> str:
    """Say on which side of 1 a radius is."""
    return f"{links.radius_name} {'< 1' if links.radius.upper < 1 else '>= 1'}"


def _why_unknown(checked: Check) -> str:
    if checked.links.why:
        return checked.links.why
    if checked.byzantine:
        return "robots lie"
    if isnan(checked.rho.upper):
        return checked.why
    return checked.undecided if isnan(checked.rho.radius) else ""
