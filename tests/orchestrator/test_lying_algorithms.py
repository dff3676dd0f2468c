"""Robots that lie by another algorithm, against the same robots in plain NumPy."""

import numpy as np
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.bus.keys import TARGET
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.cli.theory_text import convergence_rows
from nrs_cosim.orchestrator.engine.robots import agents_of
from nrs_cosim.orchestrator.engine.run import needs_of, run
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.recordings.export.tables import LINK_EVENTS, SAMPLES, STATES, rows
from nrs_cosim.recordings.mcap.reader import Reader
from tests.estimator_agents.agents_without_bus import meet, whole
from tests.scenarios import paper

H, TICKS, LIAR = 0.1, 40, 2
ALPHA, BETA = 0.7, 0.6
EDGES = [(0, 1), (1, 2), (2, 3), (3, 1), (2, 4), (3, 4), (4, 2), (1, 4)]
OTHER = {"name": "dcea2", "alpha": 0.5, "beta": 0.4}
PI = {"name": "pi_consensus", "alpha": 0.5, "beta": 0.4, "kappa": 0.2}


def scenario(lies, algorithm=None, **changes):
    """Return four robots in a run of 4 s; the target moves by 1 rad/s and − 2 rad/s."""
    honest = {"name": "dcea1", "alpha": ALPHA, "beta": BETA}
    return paper(
        {
            "run": {"duration": TICKS * H, "sampling_period": H, "seed": 5},
            "network": {"edge_list": EDGES},
            "algorithm": algorithm or honest,
            "target": {"axes": [{"offset": 1.0, "rate": 1.0}, {"offset": 0.5, "rate": -2.0}]},
            "disturbance": None,
            "initial": {"position": {"uniform": [-3.0, 3.0]}, "velocity": 0.5},
            "faults.byzantine": lies,
            **changes,
        }
    )


def lie(algorithm=OTHER, robot=LIAR, **more):
    return {"robot": robot, "kind": "algorithm", "algorithm": algorithm, **more}


def first_order(x, dx, integral):
    return x + np.stack([ALPHA * dx[0], BETA * dx[1]]), integral


def second_order(x, dx, integral):
    return x + np.stack([0 * dx[0], 0.5 * dx[0] + 0.4 * dx[1]]), integral


def with_integral(x, dx, integral):
    integral = integral + dx[0]
    return x + np.stack([0.5 * dx[0] + 0.2 * integral, 0.4 * dx[1]]), integral


def in_numpy(experiment, says):
    """Return what nodes send to all, and the estimates at t_k⁺, (ticks, n + 1, 2, m) each.

    `says` has, by robot, the step by which it lies and to whom, None for all.
    """
    start = experiment.initial_estimates()
    x = np.zeros((5, 2, 2))
    x[1:, 0], x[1:, 1] = start.position, start.velocity
    other = {robot: x[robot].copy() for robot in says}
    integral = dict.fromkeys(says, 0.0)
    sent, estimates = [], []
    for k in range(1, TICKS + 1):
        t = k * H
        x[0] = [[1 + t, 0.5 - 2 * t], [1, -2]]
        x[1:, 0] += H * x[1:, 1]
        for lying in other.values():
            lying[0] += H * lying[1]
        public = x.copy()
        for robot, (_, to) in says.items():
            if to is None:
                public[robot] = other[robot]

        def received(j, i, public=public, then=dict(other)):  # noqa: B006, as it is at this tick
            lies = j in says and i in (says[j][1] or ())
            return then[j].copy() if lies else public[j]

        def apart(i, own, received=received):
            return np.mean([received(j, i) - own for j, sink in EDGES if sink == i], axis=0)

        after = {i: first_order(x[i], apart(i, x[i]), 0.0)[0] for i in range(1, 5)}
        lies = {r: step(other[r], apart(r, other[r]), integral[r]) for r, (step, _) in says.items()}
        for i, own in after.items():
            x[i] = own
        for robot, (own, total) in lies.items():
            other[robot], integral[robot] = own, total
        sent.append(public)
        estimates.append(x.copy())
    return np.array(sent), np.array(estimates)


def recorded(experiment, path):
    """Run and verify an experiment; return samples, (ticks, 5, 2, m), and left limits."""
    outcome = run(experiment, path / "run.mcap")
    assert outcome.status == "completed"
    with Reader(outcome.path) as reader:
        assert verify(reader, experiment, plants=True).status == "identical"
    samples, states = (messages(path, table) for table in (SAMPLES, STATES))
    sent = np.stack([samples["position"], samples["velocity"]], axis=1).reshape(TICKS, 5, 2, 2)
    times = [experiment.clock.t(k) for k in range(1, TICKS + 1)]
    then = states[np.isin(states["time_ns"], times)]
    lefts = np.stack([then["reference_position"], then["reference_velocity"]], axis=1)
    return sent, lefts.reshape(TICKS, 4, 2, 2)


def messages(path, table):
    with Reader(path / "run.mcap") as reader:
        return np.concatenate([found for _, found in rows(reader, [table])])


def left_limits(experiment, estimates):
    """Return ε_i, υ_i at t_k, (ticks, 4, 2, m), from those right after the ticks before."""
    start = experiment.initial_estimates()
    first = np.stack([start.position, start.velocity], axis=1)[None]
    left = np.concatenate([first, estimates[:-1, 1:]])
    left[:, :, 0] += H * left[:, :, 1]
    return left


@pytest.mark.parametrize(
    ("lies", "says"),
    [
        ([lie()], {2: (second_order, None)}),
        ([lie(PI)], {2: (with_integral, None)}),
        ([lie(PI, to=[4])], {2: (with_integral, [4])}),
        (
            [lie(to=[3]), lie(PI, robot=3, to=[1, 4])],
            {2: (second_order, [3]), 3: (with_integral, [1, 4])},
        ),
        ([lie(PI, robot=3), lie(robot=4)], {3: (with_integral, None), 4: (second_order, None)}),
    ],
    ids=["to all", "with a memory", "to one", "to one that lies on", "two to all"],
)
def test_the_others_go_by_what_the_other_algorithm_says(tmp_path, lies, says):
    experiment = scenario(lies)
    sent, lefts = recorded(experiment, tmp_path)
    expected, estimates = in_numpy(experiment, says)
    np.testing.assert_allclose(sent, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(lefts, left_limits(experiment, estimates), rtol=0, atol=1e-12)
    _, honest = in_numpy(experiment, {})
    assert np.abs(estimates - honest).max() > 0.01


def test_what_is_told_to_some_is_a_link_event_and_the_sample_is_the_robots_own(tmp_path):
    experiment = scenario([lie(to=[4])])
    sent, lefts = recorded(experiment, tmp_path)
    events = messages(tmp_path, LINK_EVENTS)
    assert (sent[:, LIAR] == lefts[:, LIAR - 1]).all()
    assert {*zip(events["source"].tolist(), events["robot"].tolist(), strict=True)} == {(LIAR, 4)}
    to_all, _ = recorded(scenario([lie(OTHER, to=[4]), lie(OTHER)]), tmp_path)
    assert np.abs(to_all[:, LIAR] - lefts[:, LIAR - 1]).max() > 0.01


def test_it_is_told_in_its_time_and_goes_on_meanwhile_and_later_lies_are_of_it(tmp_path):
    some, lefts = recorded(
        scenario(
            [
                lie(times=[[1.0, 2.0]]),
                {"robot": LIAR, "kind": "offset", "value": 0.25, "times": [[1.5, 9.0]]},
            ]
        ),
        tmp_path,
    )
    k = np.arange(1, TICKS + 1)
    by_other = (k >= 10) & (k < 20)
    own = lefts[:, LIAR - 1] + np.where(k >= 15, 0.25, 0)[:, None, None]
    assert (some[~by_other, LIAR] == own[~by_other]).all()
    assert np.abs(some[by_other, LIAR] - own[by_other]).max() > 0.01
    jump = (some[14, LIAR] - some[13, LIAR]) - (some[13, LIAR] - some[12, LIAR])
    assert jump[0] == pytest.approx([0.25, 0.25], abs=0.05)


TRIGGERED = {"name": "event_triggered", "alpha": ALPHA, "beta": BETA, "c0": 1e9, "d0": 1e9}


@pytest.mark.parametrize(
    ("when", "many"), [({}, TICKS), ({"times": [[1.0, 2.0]]}, 11), ({"to": [4]}, 1)]
)
def test_beside_triggered_robots_it_sends_when_the_lie_to_all_does(tmp_path, when, many):
    """All are silent after the first, but for one that lies by an algorithm that always sends."""
    run(scenario([lie(**when)], TRIGGERED), tmp_path / "run.mcap")
    found = np.bincount(messages(tmp_path, SAMPLES)["robot"])
    assert found.tolist() == [TICKS, 1, many, 1, 1]


def test_a_liar_in_an_outage_says_nothing_and_its_other_algorithm_receives_nothing(tmp_path):
    out = {"id": LIAR, "outages": [[1.0, 2.0]]}
    experiment = scenario([lie()], **{"faults.robots": [out]})
    outcome = run(experiment, tmp_path / "run.mcap")
    with Reader(outcome.path) as reader:
        assert verify(reader, experiment, plants=True).status == "identical"
    found = messages(tmp_path, SAMPLES)
    mine = found[found["robot"] == LIAR]
    assert mine["k"].tolist() == [*range(1, 10), *range(20, TICKS + 1)]


def test_check_names_the_algorithm_by_which_a_robot_lies():
    found = check(scenario([lie(to=[4])]))
    assert convergence_rows(found)["byzantine"] == (
        "robot 2 lies, robot 2 by dcea2 (alpha = 0.5, beta = 0.4); what follows is of the others"
    )
    assert found.as_json()["lying_by"] == [
        {"robot": 2, "algorithm": "dcea2 (alpha = 0.5, beta = 0.4)"}
    ]
    assert found.status(found.conditions[0]) == "void"


@pytest.mark.parametrize(
    ("entry", "fault"),
    [
        (
            {"algorithm": None},
            "faults.byzantine[0].algorithm: missing; give its name and parameters, as in",
        ),
        ({"value": 1.0}, "faults.byzantine[0].value: expected none beside an algorithm, got 1.0"),
        (
            {"kind": "offset", "value": 1.0},
            'faults.byzantine[0].algorithm: expected none of kind offset; give kind = "algorithm"',
        ),
        (
            {"algorithm": {"name": "dcea3", "alpha": 1.0, "beta": 1.0, "gamma": 1.0}},
            "faults.byzantine[0].algorithm.name: dcea3 sends position [2], velocity [2], "
            "acceleration [2], and the others go by position [2], velocity [2]; take one that",
        ),
        (
            {"algorithm": TRIGGERED},
            "faults.byzantine[0].algorithm.name: event_triggered decides when it sends, and",
        ),
        (
            {"algorithm": {"name": "dcea2", "alpha": 1.0}},
            "faults.byzantine[0].algorithm.beta: missing",
        ),
        (
            {"algorithm": OTHER | {"alpha": -1.0}},
            "faults.byzantine[0].algorithm.alpha: expected greater than 0, got -1",
        ),
        (
            {"algorithm": OTHER | {"gama": 1.0}},
            "faults.byzantine[0].algorithm.gama: unknown key",
        ),
        (
            {"algorithm": {"name": "dcea9"}},
            "faults.byzantine[0].algorithm.name: expected one of dcea1",
        ),
        (
            {"algorithm": {"name": "push_sum", "missing": "drop"}},
            "faults.byzantine[0].algorithm.missing: expected one of hold, which push_sum knows",
        ),
    ],
)
def test_what_cannot_be_run_beside_is_refused_by_name(entry, fault):
    wrong = {key: value for key, value in (lie() | entry).items() if value is not None}
    with pytest.raises(ScenarioError) as refused:
        scenario([wrong])
    assert fault in str(refused.value)


ALL_LIE = [lie(to=[3]), lie(PI, robot=3, to=[1, 4]), lie(PI, robot=4)]
FAULTY = [{"loss": 0.2, "delay": {"uniform": [0, 2]}}]


def saved_by(parts):
    return {
        int(robot): part.save(row, part.state)
        for part in parts
        for row, robot in enumerate(part.robots)
    }


@pytest.mark.parametrize("links", [[], FAULTY], ids=["sound", "faulty"])
def test_any_partition_and_restart_gives_the_same_bits(links):
    experiment = scenario(ALL_LIE, **{"faults.links": links})
    layouts = [[[1, 2, 3, 4]], [[1], [2], [3], [4]], [[1, 3], [2, 4]]]
    whole_, apart, mixed = ([agents_of(experiment, robots) for robots in of] for of in layouts)
    for k in range(1, TICKS + 1):
        if k in (15, 30):
            saved = saved_by(apart if k == 15 else whole_)
            mixed = [agents_of(experiment, robots) for robots in layouts[2]]
            for part in mixed:
                part.state = part.restore([saved[int(robot)] for robot in part.robots])
        t = k * H
        target = {"position": np.array([1 + t, 0.5 - 2 * t]), "velocity": np.array([1.0, -2.0])}
        for parts in (whole_, apart, mixed):
            meet(parts, k, H, target)
        for name in ("position", "velocity"):
            bits = whole(whole_, name).tobytes()
            assert whole(apart, name).tobytes() == bits, k
            assert whole(mixed, name).tobytes() == bits, k


def test_a_worker_needs_what_the_liar_receives_too():
    """Robot 3 receives from 2 alone, which lies to it by what it receives from 1 and 4."""
    assignment = {f"w{robot}": [robot] for robot in range(1, 5)} | {TARGET: [0]}
    for lies, found in (([], {"w2", TARGET}), ([lie(to=[3])], {"w1", "w2", "w4", TARGET})):
        experiment = scenario(lies)
        assert needs_of(experiment, assignment)["w3"] == found
        sources = agents_of(experiment, [3]).in_neighbours.tolist()
        assert {f"w{robot}" for robot in sources if robot} | {TARGET} == found


def test_a_checkpoint_of_other_lies_is_refused():
    """Robot 4 needs its own lie, what 3 tells it, and what 2 tells 3; robot 2 needs none."""
    experiment, others = scenario(ALL_LIE), scenario(ALL_LIE[:1])
    saved = saved_by([agents_of(experiment, [1, 2, 3, 4])])
    sizes = {robot: len(parted(checkpoint)) for robot, checkpoint in saved.items()}
    assert sizes == {1: 3, 2: 4, 3: 2, 4: 4}
    for checkpoint in (saved[4], b"odd", saved[2], joined([saved[3]])):
        with pytest.raises(InputError, match="robot 3's checkpoint was not saved by algorithm"):
            agents_of(others, [3]).restore([checkpoint])
