"""`--set` changes a scenario as if its file had been written so, and `-` is standard input."""

import io
import json
import tomllib
from types import SimpleNamespace

import pytest

import nrs_cosim
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.scenario.changes import Change, with_changes
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.scenarios import PAPER_FILE, write

SHORT = "run.duration=1.0"


def read(*changes):
    return read_scenario(PAPER_FILE, [Change.of("--set", text) for text in changes])


def digest(path):
    with Reader(path) as reader:
        return reader.digest


def ran(path, *options):
    done = nrs("run", PAPER_FILE, "-o", path, *options)
    assert done.returncode == 0, done.stderr
    return digest(path)


def test_a_run_with_changes_equals_that_of_a_changed_file(tmp_path):
    file = write(tmp_path / "changed.toml", {"run.duration": 1.0, "algorithm.alpha": 0.7})
    assert nrs("run", file, "-o", tmp_path / "file.mcap").returncode == 0
    options = ("--set", SHORT, "--set", "algorithm.alpha=0.7")
    assert ran(tmp_path / "set.mcap", *options) == digest(tmp_path / "file.mcap")
    assert ran(
        tmp_path / "both.mcap", "--set", f"{SHORT},algorithm.alpha=0.7", "--workers", "2"
    ) == (digest(tmp_path / "file.mcap"))
    checked = [
        nrs("check", *command, "--json").stdout for command in ([file], [PAPER_FILE, *options])
    ]
    assert checked[0] == checked[1]


def test_standard_input_is_a_scenario(tmp_path, monkeypatch):
    given = ran(tmp_path / "file.mcap", "--set", SHORT)
    for command in (["run", "-", "-o", tmp_path / "in.mcap"], ["check", "-"]):
        stdin = SimpleNamespace(buffer=io.BytesIO(PAPER_FILE.read_bytes()), isatty=lambda: False)
        monkeypatch.setattr("sys.stdin", stdin)
        done = nrs(*command, "--set", SHORT)
        assert done.returncode == 0, done.stderr
    assert digest(tmp_path / "in.mcap") == given
    with nrs_cosim.Recording(tmp_path / "in.mcap") as recording:
        assert recording.to_scenario().name == "stdin"


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "standard input: is empty"),
        (b"[run]\nduration = 1", "standard input: algorithm: missing, it has no default"),
        (b"\xff\xfe", "standard input: cannot be read: it is no text in UTF-8"),
        (b"\x89MCAP0\r\n", "standard input: is a recording (MCAP)"),
    ],
)
def test_an_error_on_standard_input_names_it(monkeypatch, data, words):
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(data)))
    done = nrs("check", "-")
    assert done.returncode == 2
    assert words in done.stderr


@pytest.mark.parametrize("workers", ["1", "2"])
def test_run_as_json_prints_what_info_prints(tmp_path, workers):
    path = tmp_path / "run.mcap"
    done = nrs("run", PAPER_FILE, "-o", path, "--set", SHORT, "--json", "--workers", workers)
    assert (done.returncode, done.stderr) == (0, "")
    assert json.loads(done.stdout) == json.loads(nrs("info", path, "--json").stdout)


def test_a_failed_run_prints_its_result_and_exits_1(tmp_path):
    path = tmp_path / "run.mcap"
    done = nrs("run", PAPER_FILE, "-o", path, "--set", "run.divergence_limit=1e-3", "--json")
    result = json.loads(done.stdout)
    assert (done.returncode, result["status"]) == (1, "failed")
    assert result == json.loads(nrs("info", path, "--json").stdout)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("algorithm.alfa=1", "algorithm.alfa: unknown key; did you mean 'alpha'?"),
        ("algorithm.alpha=fast", "algorithm.alpha: expected a valid number, got 'fast'"),
        ("robots=9,plant.isolate=false", "robots[0].id: expected 1 to 6, got 9"),
        ("robots=1,algorithm.alpha=1", "robots[0].algorithm: unknown key"),
        ("alpha=1", "alpha: unknown key; did you mean 'algorithm.alpha'?"),
        ("id=1", "id: unknown key; there are run, "),
        ("kp=1,seed=2", "kp: unknown key; did you mean 'controller.kp'?"),
        ("algoritm.alpha=1", "algoritm: unknown key; did you mean 'algorithm'?"),
        ("alpha", "--set: expected key=value, got 'alpha'\n"),
        ("=1", "--set: expected key=value"),
        ("run.seed=1,run.seed=2", "run.seed: is given twice"),
    ],
)
@pytest.mark.parametrize("command", ["run", "check"])
def test_an_error_in_a_change_is_named(tmp_path, command, change, words):
    where = ["-o", tmp_path / "run.mcap"] if command == "run" else []
    done = nrs(command, PAPER_FILE, *where, "--set", change)
    assert (done.returncode, list(tmp_path.iterdir())) == (2, [])
    assert words in done.stderr


def test_a_change_of_a_file_that_is_not_toml_reports_the_file(tmp_path):
    file = tmp_path / "bad.toml"
    file.write_text("[run\n", "utf-8")
    done = nrs("check", file, "--set", SHORT)
    assert done.returncode == 2
    assert f"{file}: not valid TOML" in done.stderr
    file.write_text("robots = 3\n", "utf-8")
    done = nrs("check", file, "--set", "robots=1,plant.isolate=false")
    assert (done.returncode, "[[robots]]" in done.stderr) == (2, True)


def test_another_form_of_network_replaces_the_old_one(tmp_path, monkeypatch):
    ring = read('network.generator={kind="ring",n=4}', SHORT)
    assert (ring.n, ring.scenario.network.adjacency) == (4, None)
    (tmp_path / "edges.csv").write_text("source,sink\n0,1\n1,2\n")
    monkeypatch.chdir(tmp_path)
    assert read("network.edges=edges.csv").n == 2
    kept = read("network.pinning=[1,1,1,1,1,1]").topologies.links
    assert pairs_of(kept) >= {(0, robot) for robot in range(1, 7)}


def pairs_of(links):
    return set(zip(links.source.tolist(), links.sink.tolist(), strict=True))


def test_a_changed_form_of_times_or_target_replaces_the_old_one():
    listed = read("run.sampling_times=[0.1,0.3],run.duration=0.6")
    assert [listed.clock.t(k) for k in range(5)] == [ns * 100_000_000 for ns in (0, 1, 3, 4, 6)]
    again = read("run.sampling_times=[0.1,0.3],run.duration=0.6", "run.sampling_period=0.2")
    assert again.clock.period == 200_000_000
    still = read('target={kind="sampled",times=[0,30],positions=[[0,0],[0,0]]}')
    assert still.target.bounds() == (0, 0)


def test_a_table_that_is_set_to_nothing_is_emptied():
    text = "[faults]\ndelay = 0.1\n[[faults.links]]\nloss = 0.5\n[run]\nduration = 1.0\n"
    changed = tomllib.loads(with_changes(text, [Change.of("--set", "faults={}")]))
    assert changed == {"faults": {}, "run": {"duration": 1.0}}


def test_a_change_for_some_robots_leaves_the_others():
    changed = read("robots=2-3,controller.kp=7", "robots=3,plant.parameters={m1=2.0}")
    assert [body.kp[0, 0] for body in changed.bodies()] == [200, 7, 7, 200, 200, 200]
    assert [body.parameters.get("m1") for body in changed.bodies()][1:4] == [None, 2.0, None]


def test_extending_a_completed_run_equals_a_longer_run(tmp_path):
    short, longer = tmp_path / "short.mcap", tmp_path / "longer.mcap"
    ran(short, "--set", SHORT)
    done = nrs("resume", short, "-o", longer, "--set", "run.duration=2.5", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert (result["status"], result["ticks"]) == ("completed", 25)
    assert result["digest"] == ran(tmp_path / "whole.mcap", "--set", "run.duration=2.5")
    assert nrs("replay", longer, "--verify").returncode == 0


def test_a_run_failed_at_a_limit_continues_with_a_higher_one(tmp_path):
    failed, whole = tmp_path / "failed.mcap", tmp_path / "whole.mcap"
    limit = "run.divergence_limit=27"
    assert nrs("run", PAPER_FILE, "-o", failed, "--set", limit).returncode == 1
    done = nrs("resume", failed, "-o", whole, "--set", "run.divergence_limit=1e5")
    assert done.returncode == 0, done.stderr
    assert digest(whole) == ran(tmp_path / "paper.mcap")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("algorithm.alpha=0.5", "--set algorithm.alpha: what is recorded was run with another"),
        ("run.sampling_period=0.2", "--set run.sampling_period: what is recorded was run with"),
        ("robots=1,controller.kp=1", "--set controller.kp: what is recorded was run with another"),
        ("run.duration=0.5", "run.duration: expected at least 1.0 s, which are recorded, got 0.5"),
        ("run.duration=1.0", "is completed: there is nothing to resume"),
        ("run.duration=1.05", "run.duration: expected a whole number of sampling periods"),
    ],
)
def test_resume_refuses_changes_of_what_is_recorded(tmp_path, change, words):
    short = tmp_path / "short.mcap"
    ran(short, "--set", SHORT)
    done = nrs("resume", short, "-o", tmp_path / "more.mcap", "--set", change)
    assert (done.returncode, [*tmp_path.iterdir()]) == (2, [short])
    assert words in done.stderr


def test_a_change_of_a_table_to_a_number_is_refused():
    with pytest.raises(InputError, match="plant: expected a table"):
        read("plant=3")
