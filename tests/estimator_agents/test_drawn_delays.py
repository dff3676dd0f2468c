"""Bounds over links whose delays are drawn, beside agents that hold and targets that turn."""

import numpy as np
import pytest

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.theory.delays import contraction
from nrs_cosim.estimator_agents.theory.drawn_delays import worst_of_drawn
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from tests.cases import cases
from tests.estimator_agents.digraphs import drawn

CASES, TICKS, RUNS = cases(300, 15), 120, 12


def followed(rng, step, topology, most, gammas):
    """Return errors at sampling times and right after, (2, s) at most, robot by robot."""
    (gamma_1, gamma_2), h, E, back = gammas, step.h, step.truth, np.linalg.inv(step.flow)
    z, x = np.zeros((TICKS + 1, 3, RUNS)), np.zeros((TICKS + 1, len(E), topology.n, RUNS))
    newest, worst = np.zeros((len(most), RUNS), int), np.zeros((2, len(E)))
    p = v = np.zeros(RUNS)
    for k in range(TICKS):
        a = gamma_2 * rng.integers(-1, 2, RUNS)
        a = np.where(np.abs(v + a * h) > gamma_1, 0.0, a)
        z[k] = p, v, a
        right = (E @ z[k])[:, None]
        worst[0] = np.maximum(worst[0], np.abs(x[k] - right).max(axis=(1, 2)))
        x[k + 1] = np.einsum("ab,bnr->anr", step.own, x[k])
        for e, (j, i, d) in enumerate(zip(topology.source, topology.sink, most, strict=True)):
            newest[e] = np.maximum(newest[e], k - rng.integers(0, d + 1, RUNS))
            of = x[:, :, j - 1] if j else np.einsum("ab,kbr->kar", E, z)
            sent = of[newest[e], :, np.arange(RUNS)].T
            x[k + 1, :, i - 1] += topology.normalised[e] * step.received @ sent
        after = np.einsum("ab,bnr->anr", back, x[k + 1]) - right
        worst[1] = np.maximum(worst[1], np.abs(after).max(axis=(1, 2)))
        p, v = p + v * h + a * h * h / 2, v + a * h
    return worst


def test_no_target_and_no_delays_take_agents_beyond_the_bound():
    rng, tried = np.random.default_rng(31), 0
    for _ in range(CASES):
        law = (FirstOrder, SecondOrder, ThirdOrder)[rng.integers(3)]
        gains = rng.uniform(0.3, 1.1, 3 if law is ThirdOrder else 2)
        topology, h = drawn(rng, int(rng.integers(1, 4))), float(rng.choice([0.05, 0.2]))
        step, spectrum = linear_step(law(*gains), h), np.linalg.eigvals(topology.D).astype(complex)
        if not contraction([step], spectrum) < 1:
            continue
        tried += 1
        most, gammas = (
            rng.integers(0, 3, len(topology.source)),
            (float(rng.choice([0.3, 3.0])), 1.0),
        )
        bound, always = worst_of_drawn(step, topology, most, gammas, 0.0)
        at, after = followed(rng, step, topology, most, gammas)
        assert at[0] <= bound.position * (1 + 1e-9)
        assert at[1] <= bound.velocity * (1 + 1e-9)
        assert max(at[0], after[0]) <= always.position * (1 + 1e-9)
        assert max(at[1], after[1]) <= always.velocity * (1 + 1e-9)
    assert tried > CASES // 3


@pytest.mark.parametrize("d", [1, 3])
def test_a_target_of_constant_velocity_is_late_by_all_of_the_longest_delay(d):
    """Of one robot that takes what it receives: it comes to the bound where the delay does."""
    alone, step = Topology.of([[0.0]], [1.0]), linear_step(FirstOrder(1.0, 1.0), 0.1)
    bound, always = worst_of_drawn(step, alone, np.array([d]), (2.0, 0.0), 0.0)
    assert (bound.position, bound.velocity) == pytest.approx((2 * 0.1 * d, 0.0))
    assert always == bound
