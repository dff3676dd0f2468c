"""The first line of `nrs check`: what is concluded, in words."""

from typing import TYPE_CHECKING

from nrs_cosim.orchestrator.scenario.robot_ids import growth_said

if TYPE_CHECKING:
    from nrs_cosim.orchestrator.analysis.conclusion import Conclusion

_SAID = {
    "converges": "The estimates converge to a neighbourhood of the target",
    "converges in mean square": "The estimates converge in mean square to a neighbourhood of the "
    "target",
    "converges almost surely": "The estimates converge in almost every run",
    "diverges": "The estimates diverge",
}


def conclusion_sentence(found: "Conclusion") -> str:
    """Say whether the estimates converge, by what, how fast, and to within what."""
    if found.status == "unknown":
        why = f": {found.why_unknown}" if found.why_unknown else ""
        return (
            f"Whether the estimates converge is not known{why}. A study measures it: nrs sweep "
            "SCENARIO --seeds 20 -o DIRECTORY"
        )
    by = "proven" if found.proven else "by simulation, not proven"
    parts = [f"{_SAID[found.status]} ({by}: {found.source})"]
    if found.growth is not None:
        by = growth_said(found.growth, found.growth_at_most)
        parts.append(f"errors grow by {by} at each sampling time")
    if found.settling_time is not None:
        parts.append(f"{found.settling_time:.4g} s take any initial error to a millionth")
    if found.within and None not in found.within.values():
        position, velocity = found.within.values()
        parts.append(
            f"in steady state positions are within {position:.4g} and velocities within "
            f"{velocity:.4g} of the target's, for {found.of}"
        )
    return f"{'; '.join(parts)}."
