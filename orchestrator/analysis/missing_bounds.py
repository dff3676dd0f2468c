"""Why nothing is said of how far the estimates stay from the target."""

from math import isnan

from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.orchestrator.analysis.convergence import periods_of, why_unknown
from nrs_cosim.orchestrator.analysis.link_faults import lasting_digraph, link_faults_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment

UNDECIDED = "it is not decided whether the estimates converge"
_FEWER = "of agents that keep more than a position and a velocity there are bounds "


def why_no_bounds(
    experiment: Experiment,
    algorithm: Algorithm,
    recursions: list[Recursion],
    lasting: Recursion | None,
    step: LateStep | None,
    rho: RadiusBounds,
    links_bounded: bool,
) -> str:
    """Return why there are no bounds on the errors of estimates; empty where there are.

    `lasting` is the recursion of the steady state, `step` that of agents that keep more, and
    `links_bounded` says whether there is a most that links may do.
    """
    topologies, periods = experiment.topologies, periods_of(experiment)
    pulled = any(one.drag[:, 0].any() for one in recursions)
    reasons = {
        "robots lie, and the theory is of robots that do not": bool(experiment.byzantine),
        "of several digraphs there are bounds over links without faults alone": (
            not links_bounded and lasting_digraph(topologies) is None
        ),
        _why_unbounded(experiment): not links_bounded,
        why_unknown(algorithm, topologies, periods): isnan(rho.upper),
        "the algorithm pulls the estimates to the origin": pulled,
        _not_converging(rho, bool(periods.early)): rho.status != "proven",
        _FEWER + "on one digraph, at a constant period": (
            not recursions and (len(topologies.digraphs) > 1 or periods.constant_period is None)
        ),
        "the algorithm is not known to be linear": not recursions and step is None,
        "the target's sample is not that of an agent which is right": (
            step is not None and not step.step.agrees
        ),
        "a period of turns is too long for bounds on so many robots": (
            bool(recursions) and lasting is None
        ),
        "of digraphs in turn there are bounds at periodic sampling times alone": (
            topologies.switching and periods.constant_period is None
        ),
    }
    return next((why for why, so in reasons.items() if so), "")


def _why_unbounded(experiment: Experiment) -> str:
    """Return why nothing is the most that links may do."""
    faults = link_faults_of(experiment)
    if faults.loss.any():
        return "links lose samples, any number in a row: errors have mean squares, and no bound"
    if faults.noisy:
        return "links add noise, which has a variance, and no bound"
    if faults.fixed:
        return "over such links there are none"
    if experiment.missing == "drop":
        return "of delays that are drawn there are bounds where agents hold"
    return "of delays that are drawn there are bounds on one digraph where D3 says they converge"


def _not_converging(rho: RadiusBounds, jitter: bool) -> str:
    """Return why it is not proven that the estimates converge."""
    if rho.status == "not decided":
        return UNDECIDED + " under every jitter" * jitter
    if jitter and rho.lower < rho.upper:
        return "under some jitter the estimates diverge"
    return "the estimates diverge"
