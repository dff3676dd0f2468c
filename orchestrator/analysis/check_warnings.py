"""What a user is warned of before a run: conditions that are violated, and what does not converge.

Convergence is of the links that the scenario has: where they have faults, all that is not proven to
converge over them has its line. Conditions are of links without faults, and say so there.
"""

from math import isnan

from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.theory.tracking import TRACKING
from nrs_cosim.orchestrator.analysis.conditions import Check
from nrs_cosim.orchestrator.analysis.links import LinkAnalysis
from nrs_cosim.orchestrator.analysis.robot_conditions import POSITIVE
from nrs_cosim.orchestrator.scenario.robot_ids import growth_said, multiple


def warnings_of(checked: Check) -> list[str]:
    """Return a line for each condition that is violated, and one where convergence is not sure."""
    violated = [c for c in checked.conditions if not c.holds and c.source != TRACKING]
    of_liars, others = ([c for c in violated if c.of_liars is so] for so in (True, False))
    found = [_violated(c, checked.algorithm) for c in others]
    over_links = _over_links(checked) if checked.impaired else []
    found += [] if checked.impaired else _without_faults(checked)
    found = [f"of {checked.premise}: {one}" for one in found] if checked.premise else found
    return [_violated(c, checked.algorithm) for c in of_liars] + found + over_links


def _over_links(checked: Check) -> list[str]:
    links = checked.links
    if checked.convergence == "converges":
        return []
    if links.growth is not None:
        return [f"over these links {_diverge(links.growth, links.growth_at_most)} ({links.source})"]
    if links.loss and links.loss.mean_square.status == "refuted":
        line = f"in mean square, over these links, {_diverge(*[links.loss.mean_square.lower] * 2)}"
        return [line + "; almost every run converges, by simulation" * bool(links.source)]
    if not links.source:
        why = f": {links.why}" if links.why else ""
        return [f"whether the estimates converge over these links is not known{why}"]
    return [f"that the estimates converge over these links is not proven: {_basis(links)}"]


def _basis(links: LinkAnalysis) -> str:
    simulated = "by simulation, " * (links.status == "converges almost surely")
    return f"it follows {simulated}from {links.source}"


def _without_faults(checked: Check) -> list[str]:
    rho = checked.rho
    if rho.radius >= 1:
        return [_diverge(rho.radius, rho.radius)]
    if rho.lower >= 1:
        some = "some jitter lets " if checked.periods.early else ""
        return [f"{some}{_diverge(rho.lower, None)}"]
    if rho.upper >= 1:
        return [
            f"{checked.undecided}: at worst "
            f"their error is multiplied by {multiple(rho.lower)} to {multiple(rho.upper)} at each "
            f"sampling time"
        ]
    return []


def _diverge(least: float, most: float | None) -> str:
    by = growth_said(least, most)
    return f"the estimates diverge: their error grows by {by} at each sampling time"


def _violated(condition: Condition, algorithm: str) -> str:
    if condition.source == POSITIVE:
        return f"{condition.name} is not positive definite: an eigenvalue is {condition.right:g}"
    if condition.of_liars:
        return (
            f"{condition.name} is {condition.left:g}, and {condition.source} "
            f"{'is not computed' if isnan(condition.right) else f'is {condition.right:g}'}: "
            f"robots that lie may draw the others away"
        )
    if not condition.right > 0:
        return (
            f"algorithm {algorithm}: no {condition.name} above 0 is within the bound of "
            f"{condition.source}, {condition.right:.6g}; got {condition.left:g}"
        )
    return (
        f"{condition.name} = {condition.left:g} is outside (0, {condition.right:.6g}), "
        f"the bound of {condition.source}"
    )
