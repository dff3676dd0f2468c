"""Gains and a period that are designed for an accuracy keep it in runs."""

import json
import re

import numpy as np
import pytest

import nrs_cosim
from nrs_cosim.estimator_agents.theory.design import Gains
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.orchestrator.analysis import accuracy
from nrs_cosim.orchestrator.analysis.accuracy import designed
from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.link_designs import radius_name
from nrs_cosim.orchestrator.analysis.plant_bounds import plant_bounds
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.scenarios import PAPER_FILE, SCENARIOS, paper


def test_a_design_is_found_that_satisfies_inequality_6_1():
    found = designed(read_scenario(PAPER_FILE), EstimateBounds(0.5, 0.5), 0.5)
    (part,) = plant_bounds(read_scenario(PAPER_FILE))
    of = part.constants
    assert found.paper.kp == pytest.approx(of.mu_1 / 0.25 + of.rho_1)
    assert 0 < found.paper.period < 0.1
    assert found.proven.kp > found.paper.kp
    assert 0 < found.proven.period < 0.1


def resonant(frequency=38.07, amplitude=1, model="planar_robot", duration=20.0):
    """Return a robot that a disturbance in resonance shakes, as changes of the paper's example."""
    wave = {"sines": [{"amplitude": amplitude, "frequency": frequency}]}
    still = {"amplitude": 0.01, "frequency": 1}
    return {
        "run": {"duration": duration},
        "algorithm.beta": 0.9,
        "network": {"adjacency": [[0]], "pinning": [1]},
        "target.axes": [{"sines": [still]}, {"cosines": [still]}],
        "plant.fmu": model,
        "disturbance.axes": [wave, wave],
        "initial": dict.fromkeys(("position", "velocity", "q", "qd"), 0),
    }


def designed_for(scenario, gains, h):
    times = {"run.sampling_period": h, "run.output_step": h / 2}
    return paper(scenario, times, {"controller.kp": gains.kp, "controller.kd": gains.kd})


def test_designed_gains_keep_the_accuracy_where_those_of_6_1_do_not(tmp_path):
    """A disturbance in resonance with Kp: 13 times what (6.1) would have."""
    wanted = EstimateBounds(0.001, 100.0)
    shaken = resonant()
    found = designed(designed_for(shaken, Gains(2900.0, 2.28, None, None), 0.01), wanted, 0.5)
    most = {}
    for name, gains in (("paper", found.paper), ("proven", found.proven)):
        path = tmp_path / f"{name}.mcap"
        run(designed_for(shaken, gains, 0.01), path)
        assert gains.period >= 0.01
        with Reader(path) as reader:
            most[name] = measure(reader, experiment_of(reader)).position_tracking
    assert most["proven"] <= wanted.position
    assert most["paper"] > 10 * wanted.position


def accuracy_of_a_run(folder, model, seed):
    """Return the accuracy that a design promises a disturbed robot, and what a run comes to."""
    rng = np.random.default_rng(seed)
    wanted = EstimateBounds(*np.exp(rng.uniform(-3, 0, 2)).tolist())
    shaken = resonant(round(rng.uniform(1, 60), 2), 1 + seed % 2, model)
    share = float(rng.uniform(0.3, 0.7))
    found = designed(designed_for(shaken, Gains(1.0, 1.0, None, None), 0.01), wanted, share).proven
    h = min(float(f"{0.99 * found.period:.2g}"), 0.1)
    path = folder / f"designed-{model}-{seed}.mcap"
    shaken["run"] = {"duration": float(f"{100 * h:.6g}")}
    run(designed_for(shaken, found, h), path)
    with Reader(path) as reader:
        return wanted, measure(reader, experiment_of(reader))


@pytest.mark.parametrize("model", ["planar_robot", "two_link_arm"])
@pytest.mark.parametrize("seed", cases([1, 2], [2]))
def test_runs_of_random_designs_keep_their_accuracy(tmp_path, model, seed):
    wanted, measured = accuracy_of_a_run(tmp_path, model, seed)
    assert 0 < measured.position_tracking <= wanted.position
    assert 0 < measured.velocity_tracking <= wanted.velocity


def test_of_linear_robots_the_period_is_the_longest_that_sharp_bounds_allow(monkeypatch):
    linear, wanted = paper({"plant.fmu": "planar_robot"}), EstimateBounds(0.3, 0.5)
    found = designed(linear, wanted, 0.5).proven
    monkeypatch.setattr(accuracy, "steps_of", lambda _: None)
    assert found.period > 1.2 * designed(linear, wanted, 0.5).proven.period

    def tracked(h):
        times = {"run.sampling_period": h, "run.output_step": h, "run.duration": 100 * h}
        gains = {"controller.kp": found.kp, "controller.kd": found.kd, "plant.fmu": "planar_robot"}
        return ultimate_bounds(paper(times, gains)).tracking.worst_case

    within, beyond = (tracked(round(part * found.period, 6)) for part in (0.99, 1.03))
    assert max(within.position / 0.3, within.velocity / 0.5) <= 1
    assert max(beyond.position / 0.3, beyond.velocity / 0.5) > 1


@pytest.mark.parametrize("name", ["fastest", "period", "jitter", "pinning"])
def test_the_scenario_of_a_design_converges_as_was_said(name):
    scenario = nrs_cosim.Scenario.load(SCENARIOS / "paper_example_3a.toml")
    found = nrs_cosim.design(scenario, name, robots=2 if name == "pinning" else None)
    before, after = nrs_cosim.check(scenario), found.theory
    if name == "jitter":
        assert found.scenario["run.sampling_jitter"] == found.values["jitter"] > 0.2
        assert after.as_json()["convergence"] == "converges"
    elif name == "period":
        assert 0.493 <= found.scenario["run.sampling_period"] < found.values["bound"]
        assert found.values["bound"] == pytest.approx(0.493769, rel=1e-6)
        assert after.spectral_radius < 1
        longer = {"run.sampling_period": 0.494, "run.output_step": None, "run.duration": 49.4}
        assert nrs_cosim.check(scenario.replace(longer)).spectral_radius > 1
    else:
        assert after.spectral_radius == pytest.approx(found.values["spectral_radius"])
        assert after.spectral_radius < before.spectral_radius


def test_a_design_is_written_and_is_a_scenario(tmp_path):
    output = tmp_path / "fastest.toml"
    done = nrs("design", PAPER_FILE, "--fastest", "-o", output, "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["changes"] == {"algorithm.alpha": 1.0, "algorithm.beta": 1.0}
    assert result["check"]["spectral_radius"] == pytest.approx(0.5**0.5, rel=1e-6)
    assert nrs_cosim.Scenario.load(output)["algorithm.beta"] == 1.0


def test_over_late_links_the_period_and_the_gains_are_those_that_converge_there():
    """Where a sample is a period late, the bound over sound links is one at which errors grow."""
    scenario = nrs_cosim.Scenario.load(SCENARIOS / "paper_example_3a.toml")
    late = scenario.replace({"faults.links": [{"delay": 1}]})
    found = nrs_cosim.design(late, "period")
    assert found.values["source"] == ""  # it is searched
    assert 0.37 < found.scenario["run.sampling_period"] < found.values["bound"] < 0.38
    links = nrs_cosim.check(found.scenario).as_json()["links"]
    assert links["status"] == "converges"
    h = {"run.sampling_period": 0.38, "run.output_step": None, "run.duration": 38.0}
    assert nrs_cosim.check(late.replace(h)).as_json()["links"]["status"] == "diverges"
    fastest = nrs_cosim.design(late, "fastest")
    radius = nrs_cosim.check(fastest.scenario).as_json()["links"]["radius"]["upper"]
    assert radius == pytest.approx(fastest.values["spectral_radius"], abs=1e-9)
    assert radius < 0.857 < fastest.values["before"]  # of sound links the best gains come to 0.917


@pytest.mark.parametrize(
    ("fault", "name"), [({"delay": 1}, "spectral radius"), ({"loss": 0.1}, "mean-square radius")]
)
def test_what_is_least_over_links_has_its_name(fault, name):
    assert radius_name(paper({"faults.links": [fault]})) == name


def comments_of(text):
    return [line.partition("#")[2].strip() for line in text.splitlines() if "#" in line]


def test_what_is_written_says_what_was_asked_and_what_is_kept_and_nothing_of_the_values_before(
    tmp_path,
):
    given, output = tmp_path / "given.toml", tmp_path / "designed.toml"
    lines = PAPER_FILE.read_text("utf-8").splitlines()
    text = "\n".join(f"# softer\n{x}  # by hand" if x.startswith("kp") else x for x in lines)
    given.write_text(text, "utf-8")
    done = nrs("design", given, "--accuracy", "0.5", "0.5", "-o", output)
    assert f"scenario   {output}" in done.stdout.splitlines()
    scenario = nrs_cosim.Scenario.load(output)
    written = output.read_text("utf-8")
    head = " ".join(comments_of(written.partition("\n\n")[0]))
    assert "accuracy: |q - eps_0|2 -> 0.5, |qd - ups_0|2 -> 0.5" in head
    for bound in nrs_cosim.check(scenario).bounds[2:]:
        said = float(re.search(re.escape(bound.name) + r" <= ([\d.]+)", head)[1])
        assert bound.worst_case <= said <= min(1.001 * bound.worst_case, 0.5)
    kept = set(comments_of(text)) - set(comments_of(written))
    assert {"s, the paper's h", "softer", "by hand", comments_of(text)[0]} <= kept
    assert "2t + sin t" in comments_of(written)
    assert scenario["run.output_step"] == scenario["run.sampling_period"] == 0.0166


@pytest.mark.parametrize(
    ("given", "expected"), [(None, None), (0.1, 0.0986), (0.05, 0.0493), (1e-3, 1e-3)]
)
def test_the_output_step_is_the_longest_part_of_the_period_that_is_no_longer_than_it_was(
    given, expected
):
    """Of 493 000 000 ns = 2⁶ 5⁶ 17 · 29 ns the fewest parts that do are 5, 10 and 493."""
    scenario = nrs_cosim.Scenario.load(SCENARIOS / "paper_example_3a.toml")
    found = nrs_cosim.design(scenario.replace({"run.output_step": given}), "period")
    assert found.scenario["run"].get("output_step") == expected
    assert found.scenario["run.sampling_period"] == 0.493


@pytest.mark.parametrize("goal", ["--fastest", "--period", "--jitter", "--pin=1"])
def test_nothing_is_designed_where_robots_lie(goal):
    lies = 'faults.byzantine=[{robot=1,kind="stuck"}]'
    done = nrs("design", SCENARIOS / "paper_example_3a.toml", goal, "--set", lies)
    assert (done.returncode, done.stdout) == (2, "")
    assert "robots lie" in done.stderr


@pytest.mark.parametrize("goal", [("--jitter",), ("--pin", "1"), ("--accuracy", "0.1", "0.5")])
def test_what_is_proven_of_sound_links_is_not_promised_over_others(goal):
    late = "faults.links=[{delay=1}]"
    done = nrs("design", SCENARIOS / "paper_example_3a.toml", *goal, "--set", late)
    assert (done.returncode, done.stdout) == (2, "")
    assert "links have faults" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--period",), "no bound on the period is known"),
        (("--pin", "7"), "expected at most 6"),
        (("--fastest", "--set", "run.sampling_jitter=0.2"), "of a constant sampling period"),
    ],
)
def test_what_no_design_is_known_of_exits_2(arguments, said):
    done = nrs("design", PAPER_FILE, *arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert said in done.stderr


def test_a_design_of_an_unknown_goal_names_the_goals():
    scenario = nrs_cosim.Scenario.load(PAPER_FILE)
    with pytest.raises(nrs_cosim.errors.InputError, match="fastest, period, jitter, pinning, acc"):
        nrs_cosim.design(scenario, "best")
    with pytest.raises(nrs_cosim.errors.InputError, match="position: expected a number above 0"):
        nrs_cosim.design(scenario, "accuracy", velocity=1.0)


def test_a_design_finds_a_period_for_a_slow_algorithm_that_a_longer_one_does_not_keep():
    """Γ of `dcea2` has eigenvalues 1 − O(h): of 1 ns an error lasts for many million periods."""
    asked = ("design", SCENARIOS / "paper_example_3a.toml", "--accuracy", "0.1", "0.5")
    result = json.loads(nrs(*asked, "--json").stdout)["design"]
    proven = result["proven"]
    assert (proven["status"], proven["bounds_from"]) == ("found", 1e-9)
    assert 0.005 < proven["period"] < 0.01
    assert result["paper"]["status"] == "no period is short enough"
    gains = {f"controller.{name}": proven[name] for name in ("kp", "kd")}
    paper_3a = nrs_cosim.Scenario.load(SCENARIOS / "paper_example_3a.toml").replace(gains)

    def tracked(period):
        keys = ("run.sampling_period", "run.output_step", "run.duration")
        found = nrs_cosim.check(paper_3a.replace(dict.fromkeys(keys, period))).bounds
        return [bound.worst_case for bound in found if bound.name.endswith("|2")]

    within, beyond = (tracked(round(part * proven["period"], 6)) for part in (0.99, 1.05))
    assert within[0] <= 0.1
    assert within[1] <= 0.5
    assert beyond[0] > 0.1 or beyond[1] > 0.5


def test_a_design_reports_that_bounds_of_short_periods_are_not_computed_of_many_robots():
    other = 'algorithm.name="dcea2",algorithm.alpha=1.1,network.generator.n=101'
    asked = ("design", SCENARIOS / "ring_100.toml", "--accuracy", "0.1", "0.5", "--set", other)
    proven = json.loads(nrs(*asked, "--json").stdout)["design"]["proven"]
    assert (proven["status"], proven["period"]) == ("not computed", None)
    assert proven["bounds_from"] == pytest.approx(1e-3)


def test_the_design_for_an_accuracy_has_the_papers_gains_beside_it_and_a_check():
    asked = ("design", PAPER_FILE, "--accuracy", "0.5", "0.5")
    result = json.loads(nrs(*asked, "--json").stdout)
    assert result["design"]["paper"]["kp"] == pytest.approx(359.3407, abs=1e-3)
    assert result["design"]["paper"]["status"] == result["design"]["proven"]["status"] == "found"
    assert result["changes"]["controller.kp"] >= result["design"]["proven"]["kp"]
    tracked = result["check"]["tracking"]
    assert tracked["unproven"] == ["paper", "paper_of_worst_case"]
    assert tracked["worst_case"]["position"] <= 0.5
    assert tracked["worst_case"]["velocity"] <= 0.5


@pytest.mark.parametrize(
    "wrong",
    [
        ("--accuracy", "0", "1"),
        ("--accuracy", "1", "1", "--share", "1.0"),
        ("--accuracy", "1", "nan"),
    ],
)
def test_an_invalid_accuracy_exits_2(wrong):
    done = nrs("design", PAPER_FILE, *wrong)
    assert done.returncode == 2
    assert wrong[-2 if len(wrong) > 3 else 0] in done.stderr
