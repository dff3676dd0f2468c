"""What links do to convergence, in lines by name and in the sentence that follows from them."""

from collections.abc import Mapping
from math import isnan
from typing import TYPE_CHECKING, Any

from nrs_cosim.bus.plurals import count_of
from nrs_cosim.orchestrator.scenario.robot_ids import multiple

if TYPE_CHECKING:
    from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
    from nrs_cosim.estimator_agents.theory.delays import DelayMargin
    from nrs_cosim.orchestrator.analysis.links import LinkAnalysis, LossAnalysis

CONVERGE = "the estimates converge to a neighbourhood of the target"
_PERIOD = "sampling period"


def link_rows(links: "LinkAnalysis") -> dict[str, str]:
    """Return lines of what links do, and of what they might."""
    rows = {}
    margin = links.margin
    if margin and (margin.kind == "any" or margin.periods or margin.refuted):
        rows["delays"] = _margin(margin)
    if links.outages_end is not None:
        rows["outages"] = (
            f"the last is over at {links.outages_end:g} s; the steady state is of the time after it"
        )
    if links.loss:
        rows["loss"] = _losses(links.loss)
    if links.simulated:
        rows["simulated"] = (
            "errors are multiplied at a sampling time, asymptotically in almost every run, by "
            f"{links.simulated.lower:.4g} to {links.simulated.upper:.4g}, with 99.9 % confidence"
        )
    if links.why and not links.source:
        rows["links"] = f"not known of these: {links.why}"
    return rows


def links_sentence(links: "LinkAnalysis") -> str:
    """Say what follows from links, and by which statement."""
    number = ""
    if not isnan(links.radius.upper):
        over = "with these losses" if links.loss else f"with {_late(links)}"
        number = f"{links.radius_name} {_interval(links.radius)} {over}: "
    elif links.source in ("statement D3", "statement D6", "statement L3"):
        number = "whatever links delay" + " or lose" * (links.source[-2:] == "L3") + ": "
    status = {
        "converges": CONVERGE,
        "converges in mean square": f"{CONVERGE} in mean square",
        "converges almost surely": "the estimates converge in almost every run",
        "diverges": "the estimates diverge",
        "unknown": "whether the estimates converge is not known",
    }[links.status]
    how = "" if links.proven else ", by simulation"
    if links.source == "statement L4" and links.loss:
        refuted = links.loss.mean_square.status == "refuted"
        how += ", and in mean square they diverge" * (refuted and links.status != "diverges")
    return f"{number}{status}{how}" + f" ({links.source})" * bool(links.source)


def noise_sentence(noise: Mapping[str, Any]) -> str:
    """Say what noise comes to, and came to in a run, of the robot that has the most of it."""
    deviation, measured, expected = (noise[key] for key in ("deviation", "measured", "expected"))
    if deviation is None:
        return f"what it comes to is not known: {noise['why_not']}"
    parts = []
    for name, part in (("positions", "position"), ("velocities", "velocity")):
        most = max(deviation[part])
        robot = deviation[part].index(most)
        text = f"{name} {most:.4g} at robot {robot + 1}"
        if measured is not None and expected is not None:
            low, high = expected[part][robot]
            text += f" ({measured[part][robot]:.4g} measured; {low:.4g} to {high:.4g} expected)"
        parts.append(text)
    return f"standard deviation at most: {', '.join(parts)} ({noise['source']})"


def _late(links: "LinkAnalysis") -> str:
    low, high = links.delays
    if high == 0:
        return "these links"
    span = count_of(high, _PERIOD) if low == high else f"{low} to {count_of(high, _PERIOD)}"
    return f"samples {span} late"


def _interval(radius: "RadiusBounds") -> str:
    """Say on which side of 1 a radius is, in as many digits as tell."""
    lower, upper = multiple(radius.lower), multiple(radius.upper)
    number = lower if radius.upper - radius.lower < 1e-6 else f"{lower} to {upper}"
    return number + {"proven": " < 1", "refuted": " >= 1", "not decided": ""}[radius.status]


def _margin(margin: "DelayMargin") -> str:
    if margin.kind == "any":
        return "the estimates converge whatever the delays of links (statement D3)"
    if margin.periods == 0:
        return "the estimates diverge with all samples one sampling period late (statement D1)"
    least = ", and perhaps more" if margin.kind == "at least" else ""
    return (
        f"the estimates converge with all samples late by the same, up to "
        f"{count_of(margin.periods or 0, _PERIOD)}{least} (statement D1)"
    )


def _losses(loss: "LossAnalysis") -> str:
    if loss.critical is None:
        critical = ""
    elif loss.critical == 0:
        critical = "; without losses they diverge"
    elif loss.critical == 1:
        critical = "; no loss below 1 was found at which they diverge in mean square"
    else:
        critical = f"; in mean square they converge below a loss of {loss.critical:.4g}"
    return (
        f"mean-square radius {_interval(loss.mean_square)} (statement L1); almost surely "
        f"{multiple(loss.almost_sure.lower)} to {multiple(loss.almost_sure.upper)} (statement L4)"
        f"{critical}"
    )
