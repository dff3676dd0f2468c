"""Runs in which robots lie: what they send, what others make of it, and what is said of them."""

import json
from fractions import Fraction

import networkx as nx
import numpy as np
import pytest
from typer.testing import CliRunner

from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.check_warnings import warnings_of
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.results import Result
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import measure
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.export.tables import LINK_EVENTS, SAMPLES, STATES, rows, states
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.report.text import lead
from tests.estimator_agents.test_robustness import by_definition
from tests.scenarios import example, paper, write

LIAR = 4
EMPTY = np.array([])
OWN = 50.0
"""What the liar of four robots starts with, and the target, which it alone receives from, is."""


def still(graph, start, pinned, algorithm, lies, target=OWN, duration=6.0, links=()):
    """Return robots at rest of a graph of 0 … n − 1, each with a value for both of its axes."""
    adjacency = nx.to_numpy_array(graph.to_directed(), range(len(graph))).T.astype(int).tolist()
    changes = {
        "run": {"duration": duration, "sampling_period": 0.1, "seed": 3},
        "network": {
            "adjacency": adjacency,
            "pinning": [int(i + 1 in pinned) for i in range(len(adjacency))],
        },
        "algorithm": algorithm,
        "target": {"axes": [{"offset": target}] * 2},
        "disturbance": None,
        "initial": {"position": [[x, x] for x in start]},
        "faults": {"byzantine": lies, "links": links},
    }
    return paper(changes)


def four(*lies, F=1, **more):
    """Return robots of 0, 1, 2 and a liar, all of whom receive from one another."""
    start, wmsr = [0, 1, 2, OWN], {"name": "wmsr", "F": F}
    return still(nx.complete_graph(4), start, [LIAR], wmsr, lies, **more)


def lie_of(kind, value, **more):
    return {"robot": LIAR, "kind": kind, "value": value, **more}


def recorded(experiment, path):
    """Run an experiment, verify it, and return its tables."""
    outcome = run(experiment, path / "run.mcap")
    assert outcome.status == "completed"
    with Reader(outcome.path) as reader:
        assert verify(reader, experiment, plants=True).status == "identical"
        return {
            table.name: np.concatenate([found for _, found in rows(reader, [table])] or [EMPTY])
            for table in (SAMPLES, STATES, LINK_EVENTS)
        }


def after_jump(table, experiment, k):
    """Return first components of ε_i(t_k⁺) of all robots, which stay up to t_{k+1}."""
    then = table["states"]["time_ns"] == experiment.clock.t(k + 1)
    return table["states"]["reference_position"][then][:, 0]


def sent_by(table, robot, field="position"):
    found = table["samples"]
    return found[field][found["robot"] == robot][:, 0]


def test_one_lie_to_all_is_the_sample_and_w_msr_leaves_it_out(tmp_path):
    experiment = four(lie_of("stuck", {"position": 100.0}))
    table = recorded(experiment, tmp_path)
    assert (sent_by(table, LIAR) == 100).all()
    assert len(table["link_events"]) == 0
    for k, first in enumerate((Fraction(1), Fraction(4, 3), Fraction(13, 9)), 1):
        found = after_jump(table, experiment, k)[:3]
        np.testing.assert_allclose(found, [float(first), 1.5, 1.5], rtol=1e-14)
    np.testing.assert_allclose(after_jump(table, experiment, 59)[:3], 1.5, rtol=1e-12)


def test_without_outliers_left_out_all_go_where_the_liar_says(tmp_path):
    experiment = four(lie_of("stuck", {"position": 100.0}), F=0)
    table = recorded(experiment, tmp_path)
    assert after_jump(table, experiment, 1)[:3].tolist() == [25.75] * 3
    assert after_jump(table, experiment, 59)[:3] == pytest.approx([100] * 3, abs=1e-3)


def test_a_liar_that_runs_away_is_followed_where_no_outlier_is_left_out(tmp_path):
    """Of 3 k at t_k, F = 0 makes x⁺ = (3 x + 3 k)/4 of the mean: x = 3 k − 9 + 10 (3/4)^k."""
    lies = [lie_of("stuck", {"position": 0.0}), lie_of("ramp", {"position": 30.0})]
    for F, found in ((0, 111 + 10 * 0.75**40), (1, 1.5)):
        (folder := tmp_path / str(F)).mkdir()
        experiment = four(*lies, F=F)
        table = recorded(experiment, folder)
        assert sent_by(table, LIAR) == pytest.approx(3 * np.arange(1, 61), rel=1e-14)
        assert after_jump(table, experiment, 40)[:3] == pytest.approx([found] * 3, rel=1e-9)


def test_a_lie_for_each_receiver_is_on_the_links_and_the_sample_is_what_it_would_be(tmp_path):
    experiment = four(
        lie_of("stuck", {"position": 100.0}, to=[2]),
        lie_of("stuck", {"position": -100.0}, to=[1, 3]),
    )
    table = recorded(experiment, tmp_path)
    assert after_jump(table, experiment, 1)[:3].tolist() == [0.5, 1.5, 1.0]
    np.testing.assert_allclose(after_jump(table, experiment, 59)[:3], 0.75, rtol=1e-12)
    own = sent_by(table, LIAR)
    assert own[0] == OWN
    assert abs(own).max() <= OWN
    events = table["link_events"]
    assert len(events) == 3 * 60
    assert {*events["source"]} == {LIAR}
    for robot, says in ((1, -100), (2, 100), (3, -100)):
        assert (events["position"][events["robot"] == robot] == says).all()
    assert not (events["lost"] | events["outage"] | events["delay"]).any()


def test_a_ramp_is_of_the_time_since_its_lie_began(tmp_path):
    experiment = four(lie_of("ramp", {"position": 30.0}, times=[[1.0, 3.0], [4.0, 9.0]]))
    table = recorded(experiment, tmp_path)
    for k, (sent, own) in enumerate(zip(sent_by(table, LIAR), own_of(table), strict=True), 1):
        t = k / 10
        began = 1.0 if 1.0 <= t < 3.0 else min(4.0, t)
        assert sent == pytest.approx(own + 30 * (t - began), rel=1e-12)
    assert (sent_by(table, LIAR, "velocity") == 0).all()


def own_of(table):
    """Return what the liar would have sent at each tick: its reference then, a left limit."""
    mine = table["states"][(table["states"]["robot"] == LIAR) & (table["states"]["k"] > 0)]
    return mine["reference_position"][:, 0]


def test_it_is_stuck_at_what_it_starts_with_unless_told_and_only_in_time(tmp_path):
    stuck = {"robot": LIAR, "kind": "stuck", "times": [[2.0, 2.5]]}
    table = recorded(four(stuck), tmp_path)
    lies = (np.arange(1, 61) >= 20) & (np.arange(1, 61) < 25)
    assert (sent_by(table, LIAR)[lies] == OWN).all()
    assert (sent_by(table, LIAR)[~lies] == own_of(table)[~lies]).all()
    assert (own_of(table)[lies] < OWN - 1).all()


def test_lies_are_told_of_lies_in_their_order_and_those_to_one_of_what_all_are_sent(tmp_path):
    table = recorded(
        four(
            lie_of("offset", 1.0, to=[3]),
            lie_of("stuck", 7.0),
            lie_of("offset", {"position": 0.5}),
            lie_of("offset", 1.0, to=[3]),
        ),
        tmp_path,
    )
    assert {*sent_by(table, LIAR)} == {7.5}
    assert {*sent_by(table, LIAR, "velocity")} == {7.0}
    assert {*table["link_events"]["position"].ravel()} == {9.5}
    assert {*table["link_events"]["velocity"].ravel()} == {9.0}
    assert {*table["link_events"]["robot"]} == {3}


def test_noise_is_normal_and_each_lie_and_receiver_has_its_own(tmp_path):
    lies = [lie_of("noise", {"position": 2.0}), lie_of("noise", 3.0, to=[1, 2])]
    table = recorded(four(*lies, duration=30.0), tmp_path)
    events, kept = table["link_events"], table["states"]
    mine = kept[(kept["robot"] == LIAR) & (kept["k"] > 0)]
    of_all = [sent_by(table, LIAR) - mine["reference_position"][:, 0]]
    sample = table["samples"][table["samples"]["robot"] == LIAR]
    of_one = [
        (events[name][events["robot"] == robot] - sample[name])[:, axis]
        for robot in (1, 2)
        for name in ("position", "velocity")
        for axis in (0, 1)
    ]
    for drawn, spread in [*((one, 2.0) for one in of_all), *((one, 3.0) for one in of_one)]:
        assert abs(drawn.mean()) < 4 * spread / 300**0.5
        assert drawn.std() == pytest.approx(spread, rel=4 / (2 * 300) ** 0.5)
    together = np.corrcoef([*of_all, *of_one]) - np.eye(9)
    assert abs(together).max() < 4.5 / 300**0.5
    assert (sent_by(table, LIAR, "velocity") == mine["reference_velocity"][:, 0]).all()


def test_what_a_link_does_to_a_sample_it_does_to_the_lie(tmp_path):
    of_links = [{"from": LIAR, "to": 1, "quantisation": 0.5, "delay": 1}]
    table = recorded(four(lie_of("stuck", 10.3, to=[1]), links=of_links), tmp_path)
    events = table["link_events"]
    assert {*events["position"][events["robot"] == 1].ravel()} == {10.5}
    assert {*events["delay"][events["robot"] == 1]} == {1}


def circulant():
    """Return a digraph of 8 robots, each of which receives from the four before it."""
    digraph = nx.DiGraph([((i - step) % 8, i) for i in range(8) for step in (1, 2, 3, 4)])
    assert by_definition(digraph) == 2
    return digraph


EIGHT = {
    "stuck": lie_of("stuck", {"position": 100.0}),
    "ramp": lie_of("ramp", {"position": 40.0}),
    "two faces": lie_of("stuck", {"position": -100.0}, to=[5, 6]),
    "noise": lie_of("noise", {"position": 30.0}, to=[5, 6, 7, 8]),
}


@pytest.mark.parametrize("lie", EIGHT)
def test_on_a_2_2_robust_digraph_w_msr_keeps_the_honest_within_and_dcea1_does_not(tmp_path, lie):
    start, honest = [0.0, 3, 1, OWN, 2, 4, 1, 5], np.arange(1, 9) != LIAR
    lies = [EIGHT[lie], *([lie_of("stuck", {"position": 90.0}, to=[7, 8])] * (lie == "two faces"))]
    for algorithm in (
        {"name": "wmsr", "F": 1},
        {"name": "dcea1", "alpha": 0.9, "beta": 0.9},
    ):
        # Nobody but the liar receives from the target: what the honest know is among themselves.
        experiment = still(circulant(), start, [LIAR], algorithm, lies)
        (tmp_path / algorithm["name"]).mkdir()
        table = recorded(experiment, tmp_path / algorithm["name"])
        references = table["states"]["reference_position"].reshape(61, 8, 2)[:, honest]
        low, high = references.min(axis=1), references.max(axis=1)
        within = (low >= 0).all() and (high <= 5).all()
        assert within == (algorithm["name"] == "wmsr")
        if within:
            assert (high - low)[-1].max() < 1e-3
            assert (np.diff(low, axis=0) >= -1e-12).all()
            assert (np.diff(high, axis=0) <= 1e-12).all()
        else:
            assert max(-low.min(), high.max() - 5) > 10


def test_a_target_that_the_honest_receive_is_tracked_beside_a_liar(tmp_path):
    lies = [lie_of("ramp", {"position": 40.0})]
    start, wmsr = [0.0, 3, 1, OWN, 2, 4, 1, 5], {"name": "wmsr", "F": 1}
    experiment = still(nx.complete_graph(8), start, [1, 2, 3], wmsr, lies, target=4.5, duration=20)
    table = recorded(experiment, tmp_path)
    last = after_jump(table, experiment, 199)
    assert np.delete(last, LIAR - 1) == pytest.approx([4.5] * 7, abs=1e-3)


def test_the_two_scenarios_show_what_w_msr_is_for(tmp_path):
    off = {}
    for name in ("wmsr", "dcea1"):
        experiment = example(f"byzantine_{name}")
        with Reader(run(experiment, tmp_path / f"{name}.mcap").path) as reader:
            off[name] = measure(reader, experiment).position_estimate
    assert off["wmsr"] < 1e-9
    assert off["dcea1"] == pytest.approx(46, abs=0.5)


def test_errors_are_of_the_honest_robots_and_what_is_said_says_so(tmp_path):
    experiment = paper({"run.duration": 4.0}, WORST)
    with Reader(run(experiment, tmp_path / "run.mcap").path) as reader:
        kept = np.concatenate([*states(reader)])
        measured, story = measure(reader, experiment), story_of(reader, experiment)
        result = Result.of(reader, experiment)
    target = experiment.target_at(kept["t"])
    then = np.isin(kept["time_ns"], [experiment.clock.t(k) for k in range(1, 41)])
    honest = kept["robot"] != 2
    last = kept["time_ns"] >= experiment.clock.t(32)
    off = [abs(kept[f"reference_{x}"] - z).max(axis=1) for x, z in zip(NAMES, target, strict=True)]
    apart = [np.linalg.norm(kept[x] - z, axis=1) for x, z in zip(NAMES, target, strict=True)]
    assert measured.position_estimate == off[0][then & honest & last].max()
    assert measured.velocity_estimate == off[1][then & honest & last].max()
    assert measured.position_tracking == apart[0][honest & last].max()
    assert measured.velocity_tracking == apart[1][honest & last].max()
    assert measured.position_estimate < off[0][then & last].max()
    by_tick = [off[0][then & honest & (kept["k"] == k)].max() for k in range(1, 41)]
    assert story.envelopes["position_estimate"].largest.tolist() == by_tick
    assert story.steady == measured
    assert [row["status"] for row in story.subject.conditions] == ["void"] * 2 + ["holds"] * 4
    assert "Robot 2 lies: errors and envelopes are of honest robots." in lead(story)
    assert result.as_json()["byzantine"] == [2]
    assert result.lines()["byzantine"].startswith("robot 2 lies")
    assert result.theory["why_not"] == "robots lie, and the theory is of robots that do not"
    assert {row["status"] for row in result.theory["quantities"]} == {"unproven"}


NAMES = ("position", "velocity")
WORST = {"faults.byzantine": [{"robot": 2, "kind": "offset", "value": 0.01}]}
"""A small lie of the robot whose estimate is off most."""


def test_what_theory_has_of_robots_that_do_not_lie_is_void_and_not_known_to_converge():
    honest, lying = paper(), paper(WORST)
    found, void = check(honest), check(lying)
    assert [found.status(c) for c in found.conditions[:2]] == ["holds", "holds"]
    assert [void.status(c) for c in void.conditions[:2]] == ["void", "void"]
    assert {void.status(c) for c in void.conditions[2:]} == {"holds"}  # of a robot's own gains
    assert (found.convergence, void.convergence) == ("converges", "unknown")
    assert void.rho == found.rho
    assert np.isnan(void.spectral_radius)
    assert ultimate_bounds(lying).worst_case is None
    as_json = json.loads(json.dumps(void.as_json()))
    assert (as_json["byzantine"], as_json["conditions_of"]) == ([2], "robots that do not lie")
    assert as_json["settling_time"] is None
    late = check(paper(WORST, {"faults.links": [{"delay": 1}]}))
    assert (late.links.why, late.links.status, late.convergence) == (
        "robots lie",
        "unknown",
        "unknown",
    )
    assert late.premise == "links without faults and robots that do not lie"
    beyond = check(paper(WORST, {"algorithm.alpha": 3.0}))
    assert beyond.status(beyond.conditions[0]) == "violated"
    assert all(line.startswith("of robots that do not lie: ") for line in warnings_of(beyond))


def test_w_msr_asks_for_a_robust_digraph_and_for_few_liars():
    one, two = (
        check(still(circulant(), [0.0] * 8, [LIAR], {"name": "wmsr", "F": F}, [EIGHT["stuck"]]))
        for F in (1, 2)
    )
    assert [one.status(c) for c in one.conditions[:2]] == ["holds", "holds"]
    assert [two.status(c) for c in two.conditions[:2]] == ["violated", "holds"]
    assert warnings_of(two) == [
        "F is 2, and r of (r, r)-robustness, LeBlanc 2013 is 2: "
        "robots that lie may draw the others away",
        "robots not reached is 7, and the bound of statement B2 is 1: "
        "robots that lie may draw the others away",
    ]


def test_the_robustness_of_many_robots_is_unknown_and_never_called_holding_or_violated(tmp_path):
    ring = {"generator": {"kind": "ring", "n": 17, "pinned": [1]}}
    path = write(tmp_path / "many.toml", {"network": ring, "algorithm": {"name": "wmsr"}})
    found = check(read_scenario(path))
    assert found.status(found.conditions[0]) == "unknown"
    of_json = found.as_json()["conditions"][0]
    assert (of_json["status"], of_json["bound"], of_json["margin"]) == ("unknown", None, None)
    shown = CliRunner().invoke(app, ["check", "--strict", str(path)])
    assert shown.exit_code == 1
    assert "not computed" in shown.output
    assert "nan" not in shown.output


def lying(**keys):
    return {"faults.byzantine": [{"robot": 1, "kind": "offset", "value": 1.0} | keys]}


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        (lying(robot=7), "faults.byzantine[0].robot: expected 1 to 6, got 7"),
        (
            lying(robot=0),
            "faults.byzantine[0].robot: expected greater than or equal to 1, got 0",
        ),
        (lying(kind="ofset"), "faults.byzantine[0].kind: expected 'stuck', 'offset', 'ramp'"),
        (lying(valu=1), "faults.byzantine[0].valu: unknown key; did you mean 'value'?"),
        (
            lying(value={"positon": 1.0}),
            "faults.byzantine[0].value.positon: unknown key; did you mean 'position'?",
        ),
        (lying(value=None), "faults.byzantine[0].value: missing; offset needs a number, or one"),
        (
            lying(kind="noise", value=-1.0),
            "faults.byzantine[0].value: expected a standard deviation >= 0, got -1",
        ),
        (
            lying(kind="noise", value={"velocity": -1.0}),
            "faults.byzantine[0].value: expected a standard deviation >= 0, got -1",
        ),
        (lying(value="far"), "faults.byzantine[0].value: expected a valid number, got 'far'"),
        (
            lying(to=[2, 3, 6]),
            "faults.byzantine[0].to[1]: expected one of 2, 4, who receive from robot 1, got 3",
        ),
        (lying(robot=6, to=[1]), "expected a robot that receives from robot 6, but none does, got"),
        (lying(to=[2, 2]), "faults.byzantine[0].to[1]: robot 2 has been given before"),
        (lying(to=[]), "faults.byzantine[0].to: expected at least one, got []"),
        (
            lying(times=[[2.0, 1.0]]),
            "faults.byzantine[0].times[0]: expected [from, to] in s with from < to, got",
        ),
        (
            {
                "faults.byzantine": [
                    {"robot": robot, "kind": "stuck", "value": 0.0} for robot in range(1, 7)
                ]
            },
            "faults.byzantine: expected an honest robot, but all of them lie",
        ),
    ],
)
def test_what_no_robot_can_tell_is_refused_by_name(change, fault):
    entries = [{k: v for k, v in e.items() if v is not None} for e in change["faults.byzantine"]]
    with pytest.raises(ScenarioError) as refused:
        paper({"faults.byzantine": entries})
    assert fault in str(refused.value)
