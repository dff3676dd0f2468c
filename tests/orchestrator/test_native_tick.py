"""The native tick gives NumPy's bits, which is the oracle, and lets NumPy do what it cannot."""

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.engine import blocks
from nrs_cosim.orchestrator.engine import robots as engine_robots
from nrs_cosim.orchestrator.engine import run as engine_run
from nrs_cosim.orchestrator.engine.in_process import NAME, in_process
from nrs_cosim.orchestrator.engine.native.tick import (
    NativeDisagreements,
    NativeStates,
    load_tick,
)
from nrs_cosim.orchestrator.engine.run import past_of, run
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.recordings.mcap.arrangement import by_numpy
from nrs_cosim.recordings.mcap.reader import Reader
from tests.guard import VAIN
from tests.scenarios import SECOND_ORDER, paper

H = 100_000_000


@pytest.fixture(scope="module")
def native():
    found = load_tick()
    assert found
    return found


def numbers(rng, *shape):
    return rng.normal(size=shape) * 10.0 ** rng.integers(-6, 6, shape)


def digraph(rng, n, density):
    adjacency = rng.uniform(0.1, 2, (n, n)) * (rng.uniform(size=(n, n)) < density)
    np.fill_diagonal(adjacency, 0)
    return Topology.of(
        adjacency, rng.uniform(0.1, 2, n) * ((adjacency.sum(1) == 0) | (np.arange(n) < 2))
    )


@pytest.mark.parametrize("seed", range(30))
def test_agents_jump_to_the_same_bits_on_random_networks(native, seed):
    rng = np.random.default_rng(seed)
    n, m = (150 if seed < 2 else int(rng.integers(2, 30))), int(rng.integers(1, 8))
    density = 1.0 if seed < 2 else rng.uniform(0, 1)
    graphs = [digraph(rng, n, density) for _ in range(4)]
    turns = [InteractionGraphs.of(graphs[0]), InteractionGraphs(*graphs[1:3])]
    topologies = TopologySchedule.of(turns, (1, 2), 2)
    algorithm = (FirstOrder if seed % 2 else SecondOrder)(alpha=0.7, beta=0.9)
    if isinstance(algorithm, SecondOrder):
        topologies = TopologySchedule.of([InteractionGraphs.of(g) for g in graphs[:2]], (1, 2), 2)
    robots = np.flatnonzero(rng.uniform(size=n) < 0.8) + 1 if n > 4 else np.arange(1, n + 1)
    start = Values({name: numbers(rng, len(robots), m) for name in ("position", "velocity")})
    oracle, ours = (Agents(robots, topologies, algorithm, start, Clock((H,), 1, 9)) for _ in "ab")
    assert not isinstance(ours.disagree_by(partial(NativeDisagreements, native)), str)
    for k in range(1, 5):
        received = {name: numbers(rng, n + 1, m) for name in start}
        for agents in (oracle, ours):
            agents.receive(k, np.arange(n + 1), received)
            agents.jump(k, agents.left(0.1))
        for name, expected in oracle.state.items():
            assert ours.state[name].tobytes() == expected.tobytes()


@pytest.mark.parametrize("m", [1, 2, 7, 16, 40])
def test_states_are_recorded_in_the_same_bytes(native, m):
    rng, codec = np.random.default_rng(m), Codecs.of(Sizes(m)).states
    agents = SimpleNamespace(robots=np.array([2, 3, 9]))
    plants = SimpleNamespace(q=numbers(rng, 3, m), qd=numbers(rng, 3, m), tau=numbers(rng, 3, m))
    of = NativeStates(native, codec, agents, plants, limit := 1e7)
    left = Values(position=numbers(rng, 3, m), velocity=numbers(rng, 3, m))
    expected = codec.blank(agents.robots)
    expected["k"], expected["time_ns"] = 2**32 - 1, 2**63 + 5
    for name, value in zip(
        ("position", "velocity", "effort", "reference_position", "reference_velocity"),
        (plants.q, plants.qd, plants.tau, left.position, left.velocity),
        strict=True,
    ):
        expected[name] = value
    assert of.records(2**32 - 1, 2**63 + 5, left).tobytes() == expected.tobytes()
    bounded = (plants.q, plants.qd, left.position, left.velocity)
    wrong = [(array, bad) for array in bounded for bad in (np.nan, -2 * limit)]
    for array, bad in [*wrong, (plants.tau, np.inf), (plants.tau, np.nan)]:
        was, array[1, -1] = array[1, -1], bad
        assert of.records(1, 1, left) is None
        array[1, -1] = was
    assert of.records(1, 1, left) is not None


def test_what_is_more_than_a_jump_is_left_to_numpy(native):
    topologies = TopologySchedule.constant(Topology.of(np.zeros((2, 2)), np.ones(2)))
    start = Values({name: np.zeros((2, 1)) for name in EventTriggered.STATE})
    algorithm = EventTriggered(1.0, 1.0, 0.1, 0.1)
    agents = Agents(np.array([1, 2]), topologies, algorithm, start, Clock((H,), 1, 9))
    why = agents.disagree_by(partial(NativeDisagreements, native))
    assert why == "the algorithm does more than jump by the disagreement"


def with_two_fmus():
    """Return two robots of the paper's example with FMI 2, the others as they are."""
    arm = {"fmu": str(build("two_link_arm", 2))}
    return {"robots": [{"id": robot, "plant": arm} for robot in (2, 5)]}


LONG = {"run.duration": 1.5}
CASES = {
    "outputs in between": ({"run.output_step": 0.02}, ""),
    "second order": (SECOND_ORDER, ""),
    "a jump that is not known": ({"algorithm.name": "sliding"}, ""),
    "a gain that is 1": ({"algorithm.name": "pd_like", "algorithm.beta": None}, ""),
    "two FMUs": (with_two_fmus, ""),
    "checkpoints": ({"run.checkpoint_every": 4}, ""),
    "jitter": ({"run.sampling_jitter": 0.2}, ""),
    "what diverges": ({"run.divergence_limit": 40.0, "algorithm.alpha": 9.0}, ""),
    "a step that fails": (
        {"run.divergence_limit": 1e308, "algorithm.alpha": 1e200, "algorithm.beta": 1e200},
        "",
    ),
    "what diverges at once": ({"run.divergence_limit": 20.0}, ""),
    "impairments": (
        {"faults": {"links": [{"loss": 0.2}]}},
        "links have impairments",
    ),
}


def how(outcome):
    """Return how a run ended, and what is recorded of it."""
    with Reader(outcome.path) as reader:
        return outcome.status, outcome.reason, outcome.ticks, outcome.messages, reader.digest


@pytest.mark.parametrize("case", CASES)
def test_a_run_is_the_same_by_native_code_and_by_numpy(tmp_path, monkeypatch, case):
    changes, why = CASES[case]
    experiment = paper(LONG, changes() if callable(changes) else changes)

    def stop(time_ns):
        if time_ns > 0.85e9:
            raise Interrupted

    found = run(experiment, tmp_path / "native.mcap")
    by_threads = run(experiment, tmp_path / "threads.mcap", in_process(experiment, threads=2))
    cut = run(experiment, tmp_path / "cut.mcap", watch=stop)
    with Reader(cut.path) as reader:
        resumed = run(experiment, tmp_path / "resumed.mcap", past=past_of(reader))
    monkeypatch.setattr(engine_robots, "load_tick", lambda: None)
    monkeypatch.setattr(engine_run, "load_arranging", lambda: by_numpy)
    oracle = run(experiment, tmp_path / "numpy.mcap")
    assert how(found) == how(by_threads) == how(resumed) == how(oracle)
    assert found.profile.numpy_why == by_threads.profile.numpy_why == why
    assert found.profile.steps_why == by_threads.profile.steps_why
    assert oracle.profile.numpy_why == "nothing can be compiled"


def test_what_else_comes_while_a_block_is_done_is_judged_as_ever(tmp_path):
    experiment, of_target = paper(LONG), wire_key(SAMPLES, TARGET)
    put = {}

    def launch(stack, watch):
        bus, workers = in_process(experiment)(stack, watch)
        for name in (TARGET, NAME):
            put[name] = bus.publisher(wire_key(SAMPLES, name))
        put["records"] = bus.publisher(wire_key(RECORDS, NAME))
        put["ear"] = bus.listen(of_target)
        return bus, workers

    def strange(time_ns):
        if time_ns == 500_000_000:
            known = [item.payload for item in put["ear"].take()]
            put[TARGET](known[0])
            put[TARGET](known[-1][:-1])
            put[NAME](b"nothing")
            put["records"](known[0])

    plain = run(experiment, tmp_path / "plain.mcap")
    found = run(experiment, tmp_path / "found.mcap", launch, watch=strange)
    assert how(found) == how(plain)
    assert (sum(found.rejected.values()), found.repeated) == (3, 1)


def test_where_the_process_is_held_up_before_a_tick_it_does_that_tick_all_the_same(
    tmp_path, monkeypatch
):
    experiment = paper({"run.duration": 1.0})
    expected = run(experiment, tmp_path / "whole.mcap")
    monkeypatch.setattr(blocks, "MOST_SECONDS", -1.0)
    held = run(experiment, tmp_path / "held.mcap", deadline=VAIN)
    assert (held.status, held.ticks) == ("completed", expected.ticks)
    with Reader(held.path) as one, Reader(expected.path) as other:
        assert one.digest == other.digest
