"""What follows from a scenario is made once, whatever a command does with it."""

from collections import Counter
from typing import Any

import pytest

import nrs_cosim
from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.links.links import Links
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.orchestrator.engine.robots import agents_of, wire_of
from nrs_cosim.orchestrator.scenario import experiment
from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.command import nrs
from tests.scenarios import SCENARIOS

LOSSY = SCENARIOS / "paper_lossy_links.toml"
MADE = {"Clock": 1, "TopologySchedule": 1, "Links": 1, "motion_of": 1, "algorithm": 1}
OF_THEORY = {name: count for name, count in MADE.items() if name != "Links"}
"""What is made where nothing travels."""
STORED = {name: count for name, count in OF_THEORY.items() if name != "motion_of"}
"""What is made where what was said of the theory stands in the recording."""


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count how often what a scenario stands for is made."""
    found: Counter[str] = Counter()

    def count(owner: Any, name: str, what: str) -> None:
        make = getattr(owner, name)

        def counted(*args: Any, **named: Any) -> Any:
            found[what] += 1
            return make(*args, **named)

        monkeypatch.setattr(owner, name, counted)

    for of in (Clock, TopologySchedule, Links):
        count(of, "__init__", of.__name__)
    count(experiment, "motion_of", "motion_of")
    count(vars(experiment.Experiment)["algorithm"], "func", "algorithm")
    return found


@pytest.fixture
def moving(tmp_path):
    """Return the file of a scenario whose target is an FMU that was not run."""
    text = LOSSY.read_text("utf-8")
    start, end = text.index("[target]"), text.index("[plant]")
    target = (
        "[target]\nkind = 'fmu'\nfmu = 'two_link_arm'\nparameters = {q = [0.3, 0.0]}\n"
        "variables = {position = 'q', velocity = 'qd'}\n\n"
    )
    path = tmp_path / "moving.toml"
    path.write_text(text[:start] + target + text[end:], "utf-8")
    return path


@pytest.mark.parametrize("command", [["check"], ["run"], ["run", "--embed-fmus"]])
def test_a_scenario_whose_target_is_an_fmu_makes_each_once(made, moving, tmp_path, command):
    output = ("-o", tmp_path / "run.mcap") if "run" in command else ()
    done = nrs(*command, moving, "--set", "run.duration=1.0", *output)
    assert (done.returncode, dict(made)) == (0, MADE if output else OF_THEORY), done.stderr


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("lossy") / "lossy.mcap"
    assert nrs("run", LOSSY, "-o", path).returncode == 0
    return path


@pytest.mark.parametrize("workers", ["1", "2"])
def test_a_run_resolves_each_part_of_the_experiment_once(made, tmp_path, workers):
    done = nrs("run", LOSSY, "-o", tmp_path / "run.mcap", "--workers", workers)
    assert (done.returncode, dict(made)) == (0, MADE)


def test_a_check_resolves_each_part_of_the_experiment_once(made):
    assert (nrs("check", LOSSY).returncode, dict(made)) == (0, OF_THEORY)


@pytest.mark.parametrize("command", [["info"], ["info", "--json"], ["replay", "--verify"]])
def test_reading_a_recording_resolves_each_part_once(made, recording, command):
    expected = MADE if command[0] == "replay" else STORED
    assert (nrs(*command, recording).returncode, dict(made)) == (0, expected)


def test_a_report_resolves_each_part_of_the_experiment_once(made, recording, tmp_path):
    done = nrs("report", recording, "-o", tmp_path / "report.html")
    assert (done.returncode, dict(made)) == (0, OF_THEORY)


def test_a_script_resolves_each_part_once_for_run_and_once_for_recording(made, tmp_path):
    scenario = nrs_cosim.Scenario.load(LOSSY)
    assert nrs_cosim.check(scenario).warnings == nrs_cosim.check(scenario).warnings
    repr(scenario)
    nrs_cosim.run(scenario, tmp_path / "one.mcap").close()
    with nrs_cosim.run(scenario, tmp_path / "other.mcap") as recording:
        assert dict(made) == MADE
        recording.errors(), recording.analysis(), recording.report(tmp_path / "report.html")
        nrs_cosim.check(recording.to_scenario())
    assert dict(made) == dict.fromkeys(OF_THEORY, 2) | {"Links": 1}


def test_a_worker_makes_only_the_links_into_its_own_robots(made):
    lossy = read_scenario(LOSSY)
    agents_of(lossy, [2, 5])
    wire_of(lossy, {"a": [1, 3, 4, 6], "b": [2, 5]}, Signer())
    assert dict(made) == {name: 1 for name in MADE if name != "motion_of"}
