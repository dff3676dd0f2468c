"""Links that lose samples, beside all outcomes written out, closed forms and simulations."""

from functools import cache
from itertools import product

import numpy as np
import pytest

from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory import loss as of_loss
from nrs_cosim.estimator_agents.theory import simulated_links
from nrs_cosim.estimator_agents.theory.delays import common_radius
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.estimator_agents.theory.loss import (
    almost_sure,
    critical_loss,
    mean_square_radius,
)
from nrs_cosim.estimator_agents.theory.lossy_step import lossy_step
from nrs_cosim.estimator_agents.theory.second_moments import second_moments
from nrs_cosim.estimator_agents.theory.simulated_links import simulated_growth
from tests.cases import cases as count_of
from tests.estimator_agents.digraphs import drawn
from tests.estimator_agents.paper import ADJACENCY, PINNING
from tests.estimator_agents.powers import growth

EXAMPLE = Topology.of(ADJACENCY, PINNING)
CASES = count_of(900, 300)


def matrices(flow, gain, topology, delay, lossy, missing, target=0):
    """Return a matrix for each outcome of all lossy links together, and which of them are lost.

    Its states are all robots' of the last two ticks, and what came last over each lossy link. It
    is written out robot by robot, from what agents do with what comes. With a `target` of 2 the
    last columns are of what the target sends now and a tick before; else that is 0.
    """
    n, s, edges = topology.n, len(flow), len(topology.source)
    held = {e: 2 * n + place for place, e in enumerate(lossy)} if missing == "hold" else {}
    kept = 2 * n + len(held)
    size = (kept + target) * s
    unit = np.eye(size).reshape(-1, s, size)
    found = []
    for lost in product((False, True), repeat=len(lossy)):
        gone = {e for e, out in zip(lossy, lost, strict=True) if out}
        after = np.zeros((kept, s, size))
        after[n : 2 * n] = unit[:n]
        for i in range(n):
            mine = [e for e in range(edges) if topology.sink[e] == i + 1]
            there = mine if missing == "hold" else [e for e in mine if e not in gone]
            pull = np.zeros((s, size))
            for e in there:
                j = topology.source[e]
                at = delay[e] * n + j - 1 if j else kept + delay[e]
                came = unit[at] if j or target else np.zeros((s, size))
                if e in gone:
                    came = unit[held[e]]
                if e in held:
                    after[held[e]] = came
                weight = topology.weight[e] / sum(topology.weight[x] for x in there)
                pull += weight * (came - unit[i])
            after[i] = flow @ (unit[i] + gain @ pull)
        found.append(after.reshape(kept * s, size))
    return np.array(found), np.array([*product((False, True), repeat=len(lossy))])


@cache
def cases():
    """Return laws over random digraphs, some links of which lose samples, with all outcomes."""
    rng, found = np.random.default_rng(11), []
    for _ in range(CASES):
        alpha, beta = rng.uniform(0.05, 1.6, 2)
        h, missing = rng.uniform(0.05, 0.6), ("hold", "drop")[rng.integers(2)]
        flow = np.array([[1, h], [0, 1]])
        first = rng.integers(2)
        algorithm = (SecondOrder, FirstOrder)[first](alpha, beta)
        gain = np.diag([alpha, beta]) if first else np.array([[0, 0], [alpha, beta]])
        topology = drawn(rng, rng.integers(1, 3))
        edges = len(topology.source)
        lossy = [e for e in range(edges) if rng.random() < 0.6] or [0]
        lossy = lossy[:1] if missing == "hold" else lossy[:4]  # small systems, for time's sake
        loss, delay = np.zeros(edges), rng.integers(0, 2, edges)
        loss[lossy] = rng.uniform(0.05, 0.95, len(lossy))
        known = flow, gain, topology, delay, lossy, missing
        parts, lost = matrices(*known)
        chance = np.where(lost, loss[lossy], 1 - loss[lossy]).prod(axis=1)
        found.append((algorithm, h, topology, delay, loss, missing, known, parts, chance))
    return found


def stepped(case):
    algorithm, h, topology, delay, loss, missing, *_ = case
    return lossy_step(linear_step(algorithm, h), topology, delay, loss, missing)


def mean_square(case):
    *_, parts, chance = case
    size = parts.shape[1]
    whole = np.einsum("o,oac,obd->abcd", chance, parts, parts, optimize=True)
    return growth(whole.reshape(size**2, -1)) ** 0.5


def test_the_mean_square_radius_is_the_growth_over_all_outcomes():
    for case in cases():
        found = mean_square_radius([stepped(case)])
        assert found.lower == found.upper
        assert found.upper == pytest.approx(mean_square(case), abs=3e-6)
        gains = case[0].alpha <= 1 and case[0].beta <= 1
        if isinstance(case[0], FirstOrder) and gains:
            assert found.upper < 1  # statement L3


def test_of_large_components_the_radius_is_between_proven_bounds(monkeypatch):
    exact = [mean_square_radius([stepped(case)]).upper for case in cases()]
    monkeypatch.setattr(of_loss, "DENSE", 2)
    within = 0
    for case, radius in zip(cases(), exact, strict=True):
        found = mean_square_radius([stepped(case)])
        assert found.lower * (1 - 1e-9) <= radius <= found.upper * (1 + 1e-9)
        within += found.upper - found.lower < 1e-3
    assert within > 0.9 * CASES


def test_almost_every_run_is_within_the_proven_bounds_and_near_the_simulated(monkeypatch):
    """All cases are simulated at once, a few runs of each, with the outcomes drawn as a whole."""
    monkeypatch.setattr(simulated_links, "RUNS", 50)
    monkeypatch.setattr(simulated_links, "TICKS", 200)
    rng, size, runs, ticks = np.random.default_rng(12), 10, 8, 500
    some = cases()
    outcomes = max(len(case[-1]) for case in some)
    parts = np.zeros((len(some), outcomes, size, size))
    ends = np.ones((len(some), outcomes))
    for at, case in enumerate(some):
        o, p = case[-2].shape[:2]
        parts[at, :o, :p, :p] = case[-2]
        ends[at, : o - 1] = np.cumsum(case[-1])[:-1]
    x = rng.normal(size=(len(some), runs, size))
    growing, which = np.zeros((len(some), runs)), np.arange(len(some))[:, None]
    for tick in range(ticks):
        drawn_now = (rng.random((len(some), runs, 1)) > ends[:, None]).sum(axis=2)
        x = (parts[which, drawn_now] @ x[..., None])[..., 0]
        largest = np.abs(x).max(axis=2)
        largest[largest == 0] = 1e-300
        x /= largest[:, :, None]
        growing += np.log(largest) if tick >= 200 else 0
    rate = growing / (ticks - 200)
    far = 0
    for number, (case, one) in enumerate(zip(some, rate, strict=True)):
        proven = almost_sure([stepped(case)], mean_square_radius([stepped(case)]).upper)
        # The growth of a Jordan block is above λ by some ln k/k.
        off = 5 * one.std(ddof=1) / runs**0.5 + 1e-2
        low, high = np.exp(one.mean() + np.array([-off, off]))
        assert proven.lower * (1 - 1e-9) <= high
        assert low <= proven.upper * (1 + 1e-9)
        if number % 8 == 0:
            algorithm, h, topology, delay, loss, missing, *_ = case
            step = linear_step(algorithm, h)
            found = simulated_growth(step, topology, delay, delay, loss, missing)
            far += not (found.lower <= high * (1 + 5e-3) and low <= found.upper * (1 + 5e-3))
    assert far <= 1


def test_of_one_robot_that_drops_all_is_known_in_closed_form():
    alone = Topology.of([[0.0]], [1.0])
    for alpha, p in product((0.3, 1.0, 1.7), (0.1, 0.6)):
        lossy = lossy_step(
            linear_step(FirstOrder(alpha, alpha), 0.1), alone, np.array([0]), np.array([p]), "drop"
        )
        left = abs(1 - alpha)
        square = (p + (1 - p) * left**2) ** 0.5
        assert mean_square_radius([lossy]).upper == pytest.approx(square, rel=1e-12)
        assert almost_sure([lossy], square).lower == pytest.approx(left ** (1 - p), abs=1e-9)


def test_of_the_paper_s_example_half_the_samples_lost_converge_almost_surely_alone():
    step, edges = linear_step(SecondOrder(1.1, 0.9), 0.4), len(EXAMPLE.source)

    def at(loss):
        return [lossy_step(step, EXAMPLE, np.zeros(edges, int), np.full(edges, loss), "drop")]

    assert mean_square_radius(at(0.5)).upper == pytest.approx(1.07396498, abs=1e-8)
    still, half = np.zeros(edges, int), np.full(edges, 0.5)
    found = simulated_growth(step, EXAMPLE, still, still, half, "drop")
    assert found.lower < 0.98853 < found.upper < 1
    critical = critical_loss(at)
    assert (
        mean_square_radius(at(critical - 1e-5)).upper < 1 < mean_square_radius(at(critical)).upper
    )
    assert critical_loss(lambda loss: at(loss) if loss < 0.2 else at(0.1)) == 1.0


def test_what_does_not_converge_without_losses_has_no_critical_one_and_too_much_no_recursion():
    step, alone = linear_step(FirstOrder(2.5, 0.5), 0.1), Topology.of([[0.0]], [1.0])
    zero = np.array([0])
    assert critical_loss(lambda p: [lossy_step(step, alone, zero, np.array([p]), "drop")]) == 0
    many = Topology.of(np.zeros((500, 500)), np.ones(500))
    assert lossy_step(step, many, np.zeros(500, int), np.full(500, 0.1), "drop") is None
    assert critical_loss(lambda _: None) is None


def test_second_moments_are_those_of_many_simulated_runs():
    """All are simulated at once, from what agents keep and what the target sends."""
    rng, runs, ticks, size = np.random.default_rng(13), count_of(160, 16), 240, 10
    some = [case for case in cases() if mean_square_radius([stepped(case)]).upper < 0.9]
    assert len(some) > CASES // 3
    outcomes = max(len(case[-1]) for case in some)
    parts, ends = np.zeros((len(some), outcomes, size, size + 4)), np.ones((len(some), outcomes))
    robots = np.zeros(len(some), int)
    for at, case in enumerate(some):
        whole, _ = matrices(*case[-3], target=2)
        o, kept = whole.shape[:2]
        parts[at, :o, :kept, :kept] = whole[:, :, :kept]
        parts[at, :o, :kept, size:] = whole[:, :, kept:]
        ends[at, : o - 1] = np.cumsum(case[-1])[:-1]
        robots[at] = case[2].n
    periods, which = np.array([case[1] for case in some]), np.arange(len(some))[:, None]
    # Whole turns of the target in the ticks that are averaged.
    omega = 2 * np.pi * rng.integers(2, 40, len(some)) / (ticks - 100) / periods

    def truth(k):
        angle = omega * k * periods + 0.4
        return np.stack([3 + periods * k / 2 + np.sin(angle), 0.5 + omega * np.cos(angle)], axis=1)

    x = np.zeros((len(some), runs, size))
    squares = np.zeros((len(some), runs, 4))
    for k in range(ticks):
        now = truth(k)
        if k >= 100:
            squares += (x[:, :, :4] - np.tile(now, 2)[:, None]) ** 2 / (ticks - 100)
        sent = np.concatenate([now, truth(k - 1)], axis=1)[:, None] + np.zeros((1, runs, 1))
        drawn_now = (rng.random((len(some), runs, 1)) > ends[:, None]).sum(axis=2)
        given = np.concatenate([x, sent], axis=2)[..., None]
        x = (parts[which, drawn_now] @ given)[..., 0]
    for at, case in enumerate(some):
        n = robots[at]
        step = linear_step(case[0], case[1])
        wave = np.ones((1, 1)), np.full((1, 1), omega[at]), np.full((1, 1), 0.4)
        target = Harmonic(np.array([3.0]), np.array([0.5]), *wave)
        found = second_moments(stepped(case), step, n, target)
        expected = (found.mean + found.spread)[:, :, 0].T.ravel()
        measured = squares[at, :, : 2 * n]
        off = 6 * measured.std(axis=0, ddof=1) / runs**0.5
        assert np.all(np.abs(measured.mean(axis=0) - expected) <= off + 0.03 * expected + 1e-12)


def test_over_links_that_lose_nothing_the_simulated_growth_is_the_radius():
    """With delays that are fixed, and with drawn ones that hold or drop, which D3 says converge."""
    edges = len(EXAMPLE.source)
    no = np.zeros(edges)
    for missing, delay in (("hold", 0), ("drop", 1), ("hold", 2)):
        step, late = linear_step(SecondOrder(1.1, 0.9), 0.4), np.full(edges, delay)
        found = simulated_growth(step, EXAMPLE, late, late, no, missing)
        radius = common_radius(step, np.linalg.eigvals(EXAMPLE.D).astype(complex), delay)
        assert found.lower < radius < found.upper
        assert found.upper - found.lower < 5e-3
    for missing in ("hold", "drop"):
        step, still = linear_step(FirstOrder(0.9, 1.0), 0.1), np.zeros(edges, int)
        assert simulated_growth(step, EXAMPLE, still, still + 2, no, missing).upper < 1


def test_too_many_links_are_not_simulated(monkeypatch):
    monkeypatch.setattr(simulated_links, "WORK", 1e5)
    step, late = linear_step(FirstOrder(0.9, 1.0), 0.1), np.zeros(len(EXAMPLE.source), int)
    assert simulated_growth(step, EXAMPLE, late, late, late / 2, "hold") is None
