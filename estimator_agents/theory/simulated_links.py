"""How errors grow over links as they are drawn: many runs at once, without a target.

At t_k the sample of t_s is there if it was sent over d = k − s periods, and is not lost; of those
that are, an agent goes by the newest, if it is newer than the last. So it is for any delays that
are drawn, losses, and either policy. The growth of a run is the slope of a line through ln ‖x‖; its
mean over runs is normally distributed, but for what the line misses of swings and beginnings.
"""

from collections.abc import Sequence
from math import exp

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Missing
from nrs_cosim.estimator_agents.theory.aperiodic import RadiusBounds
from nrs_cosim.estimator_agents.theory.late_states import Delays, factors
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep
from nrs_cosim.estimator_agents.theory.lossy_step import by_digraph

Array = NDArray[np.float64]

Turns = tuple[Sequence[Array], Sequence[int]]
"""w_ij/ϖ_i of each exchange, as in `lossy_step.TickEdges`, and which holds at a period's ticks."""

RUNS, TICKS, FEWEST, WORK = 200, 1000, 200, 1e8
"""How many, how long, and how long at least; samples that all of them may take."""
SIGMAS = 3.29
"""Standard errors around a mean: 99.9 % of a normal distribution is within."""
OFTEN = 8
"""Ticks after which numbers are brought to a size of 1 again."""


def simulated_growth(
    step: LinearStep,
    topology: Topology,
    least: Delays,
    most: Delays,
    loss: Array,
    missing: Missing,
    turns: Turns | None = None,
) -> RadiusBounds | None:
    """Return where e^λ of almost every run lies, with a confidence of 99.9 %.

    Of digraphs in turn `topology` has the edges of all, and `turns` their weights and order. None
    of too many links, and where it is not known what the law does without a sample.
    """
    edges, longest = len(loss), int(most.max(initial=0)) + 1
    ticks = min(TICKS, int(WORK / (RUNS * (edges + longest * topology.n))))
    if ticks < FEWEST or (missing == "drop" and step.alone is None):
        return None
    weights, order = turns or ([topology.normalised[None]], [0])
    has = [weight.any(axis=0) for weight in weights]
    holds, (U, V) = missing == "hold", factors(step.received)
    alone = np.zeros_like(step.own) if holds or step.alone is None else step.alone
    parts = [[*by_digraph(step, U, V, alone, len(weight))] for weight in weights]
    (s, r), n = U.shape, topology.n
    rng = np.random.Generator(np.random.Philox(15))
    start = np.searchsorted(topology.sink, np.arange(1, n + 1))
    robots = topology.source > 0
    source = np.where(robots, topology.source - 1, 0)
    x, sizes = rng.normal(size=(s, RUNS, n)), [np.zeros(RUNS)]
    past, held = np.zeros((longest, r, RUNS, n)), np.zeros((r, RUNS, edges))
    due, last = np.full((longest, RUNS, edges), -1), np.full((RUNS, edges), -1)
    run, edge = np.ogrid[:RUNS, :edges]
    for k in range(ticks):
        now = order[k % len(order)]
        past[k % longest] = np.tensordot(V, x, axes=1)
        delay = rng.integers(least, most + 1, (RUNS, edges))
        arrives = (rng.random((RUNS, edges)) >= loss) & has[now]
        at = (k + delay) % longest
        due[at, run, edge] = np.where(arrives, k, due[at, run, edge])
        sent = due[k % longest]
        newer = sent > last
        last = np.where(newer, sent, last)
        came = past[sent % longest, :, run, source].transpose(2, 0, 1) * robots
        due[k % longest] = -1
        held = np.where(newer, came, held) if holds else came
        after = np.tensordot(alone, x, axes=1)
        for (own, _, ahead), weight in zip(parts[now], weights[now], strict=True):
            there = np.broadcast_to(weight, newer.shape) if holds else newer * weight
            whole = np.add.reduceat(there, start, axis=1)
            mean = np.add.reduceat(held * there, start, axis=2) / np.where(whole > 0, whole, 1)
            received = np.tensordot(own, x, axes=1) + np.tensordot(ahead, mean, axes=1)
            after += np.where(whole > 0, received, 0)
        x = after
        if k % OFTEN == OFTEN - 1:
            size = np.abs(x).max(axis=(0, 2))
            if not size.all():  # the products of some run are 0, and so is e^λ
                return RadiusBounds(0.0, 0.0)
            x, held, past = x / size[:, None], held / size[:, None], past / size[:, None]
            sizes.append(sizes[-1] + np.log(size))
    story = np.array(sizes[len(sizes) // 5 :])
    place = np.arange(len(story)) - (len(story) - 1) / 2
    rate = place @ story / (place @ place) / OFTEN
    off = SIGMAS * float(rate.std(ddof=1)) / RUNS**0.5 + 1 / ticks
    return RadiusBounds(exp(rate.mean() - off), exp(rate.mean() + off))
