"""Digraphs in turn over links that are late or lose samples, beside what agents do, by edges."""

from functools import cache

import numpy as np
import pytest

from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.theory import loss as of_loss
from nrs_cosim.estimator_agents.theory import simulated_links
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.estimator_agents.theory.loss import almost_sure, mean_square_radius
from nrs_cosim.estimator_agents.theory.lossy_step import lossy_ticks
from nrs_cosim.estimator_agents.theory.simulated_links import simulated_growth
from nrs_cosim.estimator_agents.theory.switching import product_radius
from nrs_cosim.orchestrator.analysis.link_faults import LinkFaults, ticks_of, turns_of
from tests.cases import cases as count_of
from tests.estimator_agents.digraphs import drawn
from tests.estimator_agents.powers import growth

CASES = count_of(400, 12)


LONGEST, PERIODS = 2, count_of(300, 100)


def edges_of(topology):
    return [*zip(topology.source.tolist(), topology.sink.tolist(), topology.weight, strict=True)]


def written_out(law, schedule, delay, missing, k, gone=()):
    """Return the matrix of tick k, robot by robot: of ticks before too, and what each edge holds.

    No sample is due over edges that are `gone`, nor over those that no digraph had d ticks ago.
    """
    flow, gain = law
    links, n = edges_of(schedule.links), schedule.n
    held = (LONGEST + 1) * n
    size = 2 * (held + len(links))
    after, unit = np.zeros((size // 2, 2, size)), np.eye(size).reshape(-1, 2, size)
    after[n:held] = unit[: held - n]
    came = {}
    for e, ((j, i, _), d) in enumerate(zip(links, delay, strict=True)):
        then = schedule.exchanges[(k - 1 - d) % len(schedule.exchanges)]
        sent = [*edges_of(then.position), *edges_of(then.velocity)]
        if e not in gone and (j, i) in [edge[:2] for edge in sent]:
            came[j, i] = unit[d * n + j - 1] if j else np.zeros((2, size))
        elif missing == "hold":
            came[j, i] = unit[held + e]
        after[held + e] = came[j, i] if missing == "hold" else 0
    now = schedule.exchanges[k - 1]
    for i in range(n):
        pull = np.zeros((2, size))
        for part, digraph in enumerate((now.position, now.velocity)):
            there = [(j, w) for j, to, w in edges_of(digraph) if to == i + 1 and (j, to) in came]
            for j, w in there:
                share = w / sum(w for _, w in there)
                pull[part] += share * (came[j, i + 1][part] - unit[i][part])
        after[i] = flow @ (unit[i] + gain @ pull)
    return after.reshape(size, size)


@cache
def cases():
    """Return laws, digraphs in turn at one tick each, delays, losses and what agents do without."""
    rng, found = np.random.default_rng(21), []
    for _ in range(CASES):
        alpha, beta = rng.uniform(0.05, 1.6, 2)
        h, missing, first = rng.uniform(0.05, 0.6), ("hold", "drop")[rng.integers(2)], rng.random()
        n, turns, law = rng.integers(1, 4), [], np.array([[0, 0], [alpha, beta]])
        for _ in range(rng.integers(2, 4)):
            position = drawn(rng, n)
            two = first < 0.25 and rng.random() < 0.7
            turns.append(InteractionGraphs(position, drawn(rng, n) if two else position))
        if first < 0.6:
            law = np.diag([alpha, beta])
        schedule = TopologySchedule.of(turns, range(1, len(turns) + 1), len(turns))
        edges = len(schedule.links.source)
        step = linear_step((FirstOrder if first < 0.6 else SecondOrder)(alpha, beta), h)
        delay, loss = rng.integers(0, LONGEST + 1, edges), np.zeros(edges)
        loss[rng.integers(edges)] = rng.uniform(0.05, 0.95)
        found.append((step, (np.array([[1, h], [0, 1]]), law), schedule, delay, loss, missing))
    return found


def stepped(case, loss):
    step, _, schedule, delay, _, missing = case
    faults = LinkFaults(schedule.links, delay, delay, loss, False, 1, 0)
    ticks, phases = ticks_of(schedule, faults, loss)
    return lossy_ticks(step, schedule.links, delay, ticks, missing), phases


def test_over_late_links_the_radius_of_a_period_is_the_growth_of_what_agents_do():
    for case in cases():
        steps, phases = stepped(case, 0 * case[4])
        _, law, schedule, delay, _, missing = case
        turns = len(schedule.exchanges)
        by_tick = [written_out(law, schedule, delay, missing, k) for k in range(turns, 0, -1)]
        whole = np.linalg.multi_dot(by_tick)
        p = len(steps[0].fixed)
        found = product_radius([one.fixed[:, :p] for one in steps], phases)
        assert found == pytest.approx(growth(whole) ** (1 / turns), abs=2e-5)


def mean_square(case):
    """Return the growth of E x xᵀ at a tick, over all outcomes of all ticks of many periods."""
    _, law, schedule, delay, loss, missing = case
    (lossy,), turns = np.flatnonzero(loss), len(schedule.exchanges)
    chance, outcomes = (1 - loss[lossy], loss[lossy]), ((), (lossy,))
    parts = [
        [written_out(law, schedule, delay, missing, k, gone) for gone in outcomes]
        for k in range(1, turns + 1)
    ]
    X, size = np.eye(len(parts[0][0])), 0.0
    for period in range(2 * PERIODS):
        for lost_or_not in parts:
            X = sum(p * A @ X @ A.T for p, A in zip(chance, lost_or_not, strict=True))
        most = np.trace(X)
        X = X / most
        size += np.log(most) if period >= PERIODS else 0.0
    return float(np.exp(size / PERIODS / turns / 2))


def test_over_lossy_links_the_mean_square_radius_is_the_growth_over_all_outcomes(monkeypatch):
    for case in cases():
        steps, phases = stepped(case, case[4])
        found = mean_square_radius(steps, phases)
        assert found.upper == pytest.approx(mean_square(case), abs=4e-3)
        sure = almost_sure(steps, found.upper, phases)
        assert sure.lower <= sure.upper
        with monkeypatch.context() as changed:
            changed.setattr(of_loss, "DENSE", 2)
            between = mean_square_radius(steps, phases)
        assert between.lower * (1 - 1e-9) <= found.upper <= between.upper * (1 + 1e-9)


def test_the_simulated_growth_is_the_radius_where_nothing_is_drawn_and_else_below_the_squares(
    monkeypatch,
):
    monkeypatch.setattr(simulated_links, "RUNS", 30)
    monkeypatch.setattr(simulated_links, "TICKS", count_of(1000, 200))
    for case in cases()[: count_of(300, 6)]:
        step, _, schedule, delay, loss, missing = case
        turns = turns_of(schedule, schedule.links)
        for chance in (0 * loss, loss):
            shape = step, schedule.links, delay, delay, chance, missing
            found = simulated_growth(*shape, turns)
            steps, phases = stepped(case, chance)
            most = mean_square_radius(steps, phases).upper
            least = almost_sure(steps, most, phases).lower if chance.any() else most
            assert found.lower <= most * (1 + 5e-3)
            assert found.upper >= least * (1 - 5e-3)


def test_gains_below_one_contract_whatever_turns_and_delays():
    """As statements D6 and L3 have it: where agents hold, or links are late by nothing."""
    for step, law, schedule, delay, loss, missing in cases():
        if law[1][1, 0] or not np.diag(law[1]).max() < 1:
            continue
        late = delay if missing == "hold" else 0 * delay
        steps, phases = stepped((step, law, schedule, late, loss, missing), loss)
        assert mean_square_radius(steps, phases).upper < 1
