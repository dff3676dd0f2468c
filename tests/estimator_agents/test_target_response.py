"""Bounds for any target on agents that keep more, or whose links are late, beside plain runs."""

import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.dcea3 import ThirdOrder
from nrs_cosim.estimator_agents.pi_consensus import PIConsensus
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.estimates import worst_case
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.estimator_agents.theory.recursion import recursion_of
from nrs_cosim.estimator_agents.theory.target_response import worst_of_step
from tests.cases import cases
from tests.estimator_agents.digraphs import digraphs

FUZZ = settings(
    derandomize=True,
    deadline=None,
    database=None,
    max_examples=cases(300, 60),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.filter_too_much],
)
gain = st.floats(0.3, 1.1)


@st.composite
def laws(draw):
    kind = draw(st.sampled_from([FirstOrder, SecondOrder, ThirdOrder, PIConsensus]))
    if kind is PIConsensus:
        return PIConsensus(draw(gain), draw(gain), draw(st.floats(0.0, 0.4)))
    return kind(*(draw(gain) for _ in range(3 if kind is ThirdOrder else 2)))


@st.composite
def late_steps(draw):
    h, topology = draw(st.sampled_from([0.05, 0.2])), draw(digraphs(4))
    edges = len(topology.source)
    delay = np.array(draw(st.lists(st.integers(0, 2), min_size=edges, max_size=edges)), np.int64)
    return LateStep(linear_step(draw(laws()), h), topology, delay)


def target(rng, gamma_1, gamma_2, h, ticks, runs):
    """Return positions, velocities and accelerations of random targets at t_k and halfway on.

    Both are (3, ticks, runs).

    Accelerations are ±γ2 or 0 for quarters of a period, but where that would pass γ1.
    """
    z, p, v = np.zeros((2, 3, ticks, runs)), np.zeros(runs), np.zeros(runs)
    held = np.zeros(runs)
    for k in range(ticks):
        z[0, :, k] = p, v, held
        for quarter in range(4):
            if quarter == 2:
                z[1, :, k] = p, v, held
            turn = rng.random(runs) < 0.15
            held = np.where(turn, gamma_2 * rng.integers(-1, 2, runs), held)
            held = np.where(np.abs(v + held * h / 4) > gamma_1, 0.0, held)
            p, v = p + v * h / 4 + held * (h / 4) ** 2 / 2, v + held * h / 4
    return z


def followed(late, z):
    """Return errors of agents that begin at rest, (ticks, 2, n, runs), and x: robot by robot."""
    step, topology = late.step, late.topology
    E, s, n = step.truth, len(step.fields), topology.n
    edges = [*zip(topology.source, topology.sink, topology.normalised, late.delay, strict=True)]
    ticks, runs = z.shape[1:]
    x, errors = np.zeros((ticks + 1, s, n, runs)), np.zeros((ticks, 2, n, runs))
    for k in range(ticks):
        errors[k] = x[k, :2] - (E @ z[:, k])[:2, None]
        x[k + 1] = np.einsum("ab,bnr->anr", step.own, x[k])
        for j, i, weight, d in edges:
            if k >= d:
                sent = x[k - d, :, j - 1] if j else E @ z[:, k - d]
                x[k + 1, :, i - 1] += weight * step.received @ sent
    return errors, x


@settings(FUZZ)
@given(late_steps(), st.sampled_from([0.3, 1.0, 10.0]), st.integers(0, 2**32))
def test_no_target_takes_agents_beyond_the_bound(late, gamma_1, seed):
    radius = np.abs(np.linalg.eigvals(np.asarray(_dense(late.matrix())))).max()
    assume(radius < 0.8)
    bound, always = worst_of_step(late, gamma_1, 1.0, radius)
    z, mid = target(np.random.default_rng(seed), gamma_1, 1.0, late.step.h, 70, 10)
    errors, x = followed(late, z)
    found = np.abs(errors).max(axis=(0, 2, 3))
    assert found[0] <= bound.position * (1 + 1e-9)
    assert found[1] <= bound.velocity * (1 + 1e-9)
    # Right after sampling times, and halfway to the next: half of F by its powers of F − I.
    N, E = late.step.flow - np.eye(len(x[0])), late.step.truth
    after = np.einsum("ab,kbnr->kanr", np.linalg.inv(late.step.flow), x[1:])
    for part, truth in ((np.eye(len(N)), z), (np.eye(len(N)) + N / 2 - N @ N / 8, mid)):
        there = np.einsum("ab,kbnr->kanr", part, after)
        off = there[:, :2] - np.einsum("ab,bkr->kar", E, truth)[:, :2, None]
        found = np.abs(off).max(axis=(0, 2, 3))
        assert found[0] <= always.position * (1 + 1e-9)
        assert found[1] <= always.velocity * (1 + 1e-9)


@settings(FUZZ, max_examples=cases(300, 30))
@given(st.sampled_from([FirstOrder, SecondOrder]), gain, gain, digraphs(4))
def test_of_agents_without_more_it_is_the_sharp_one_where_speed_does_not_matter(
    kind, alpha, beta, topology
):
    law, h = kind(alpha, beta), 0.2
    recursion = recursion_of(law, topology, h)
    radius = np.abs(np.linalg.eigvals(recursion.matrix)).max()
    assume(radius < 0.9)
    late = LateStep(linear_step(law, h), topology, np.zeros(len(topology.source), np.int64))
    (found, _), attained = (
        worst_of_step(late, 1e9, 1.0, radius),
        worst_case(recursion, 1e9, 1.0, radius),
    )
    assert found.position == pytest.approx(attained.position, rel=1e-6)
    assert found.velocity == pytest.approx(attained.velocity, rel=1e-6)


def _dense(A):
    return A if isinstance(A, np.ndarray) else A.toarray()
