"""A recording of an algorithm that is not installed is read, compared, drawn and exported."""

import json
from hashlib import sha256
from pathlib import Path

import pytest

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes
from nrs_cosim.bus.messages import STATE
from nrs_cosim.orchestrator.engine import run as engine
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.plant_fmu.bundled.model_urdf import model_urdf
from nrs_cosim.recordings.mcap.container import Schema
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from nrs_cosim.recordings.metadata import URDFS
from tests.command import nrs
from tests.recordings import made_up_runs
from tests.scenarios import SHORT, paper, toml

N, M = 3, 2
SENT = {"position": Field(truth="position"), "P": Field((2, "m")), "level": Field(())}
KEPT = {**ESTIMATE, "last": Field(("in_degree",))}
CODECS = Codecs.of(Sizes(M, N, 2), "Mine", SENT, KEPT)
NOT_HERE = {"algorithm": {"name": "no_such_law", "gain": 0.9, "missing": "hold", "where": "here"}}
MESSAGE = (
    "algorithm.name: 'no_such_law' is not installed as it was recorded; install the package that "
    "has it as an entry point of nrs.algorithms"
)
ARM = model_urdf("n_link_arm", {"n": M}, [f"joint_{j}" for j in range(1, M + 1)]).encode()
SCENARIO = toml(NOT_HERE, base=made_up_runs.chain(N, M, 10))


def written(
    path: Path, ticks=10, schemas=(), status="completed", scenario=SCENARIO, codecs=CODECS
) -> Path:
    """Write a run of an algorithm that nobody has, with some schemas of its own."""
    by_name = {kind.name: Schema(kind.name, kind.descriptor()) for kind in codecs.types}
    by_name |= {schema.name: schema for schema in schemas}
    with made_up_runs.create(path, N, M, 10, (2,), codecs) as writer:
        writer.finish("completed")
    with Reader(path) as empty:
        channels, metadata = empty.channels, empty.metadata
    with Writer(
        path,
        version="1",
        channels=channels,
        schemas=by_name.values(),
        metadata={**metadata, URDFS: {f"{sha256(ARM).hexdigest()}.urdf": str([*range(1, N + 1)])}},
        attachments={
            "scenario.toml": ("application/toml", scenario.encode()),
            f"{sha256(ARM).hexdigest()}.urdf": ("application/xml", ARM),
        },
    ) as writer:
        for k in range(ticks + 1):
            writer.write(made_up_runs.tick(k, N, M, (2,), codecs))
        writer.finish(status)
    return path


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return written(tmp_path_factory.mktemp("not_here") / "run.mcap")


def test_it_is_told_of_with_what_was_given_to_its_algorithm(run):
    done = nrs("info", "--json", run)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["algorithm"] == {
        "name": "no_such_law",
        "parameters": {"gain": 0.9, "where": "here"},
    }
    assert found["theory"]["why_not"] == MESSAGE
    assert (found["robots"], found["ticks"], found["damage"]) == (N, 10, [])


def test_it_is_exported_compared_drawn_and_recovered(run, tmp_path):
    for command in (
        ("export", run, "-o", tmp_path / "tables"),
        ("report", run, "-o", tmp_path / "run.html"),
        ("diff", run, run),
        ("scene", run, "-o", tmp_path / "scene.mcap"),
        ("convert", run, "--to", "ros2", "-o", tmp_path / "bag"),
        ("recover", run, "-o", tmp_path / "again.mcap"),
    ):
        done = nrs(*command)
        assert done.returncode == 0, (command, done.stderr)
    names = sorted(path.name for path in (tmp_path / "tables").iterdir())
    tables = ["agent_states", "columns", "joints", "link_events", "samples", "states"]
    assert names == [f"{table}.csv" for table in tables]
    page = (tmp_path / "run.html").read_text("utf-8")
    assert "no_such_law (gain = 0.9" in page
    assert MESSAGE in page


@pytest.mark.parametrize(
    "command",
    [
        ("replay", "--verify", "--agents-only"),
        ("replay", "--algorithm", "gain=1"),
        ("replay", "--plant", "robots=1,plant.fmu=planar_robot"),
        ("export", "--format", "ssp"),
    ],
    ids=" ".join,
)
def test_what_needs_the_algorithm_names_it_and_writes_nothing(run, tmp_path, command):
    name = "new.ssp" if "export" in command else "new.mcap"
    output = () if "--verify" in command else ("-o", tmp_path / name)
    done = nrs(*command, run, *output)
    assert done.returncode == 2
    assert MESSAGE in done.stderr
    assert not (tmp_path / name).exists()


def test_it_cannot_be_resumed_and_says_so(tmp_path):
    path = written(tmp_path / "half.mcap", ticks=4, status="interrupted")
    before = path.read_bytes()
    done = nrs("resume", path)
    assert done.returncode == 2
    assert MESSAGE in done.stderr
    assert path.read_bytes() == before


def test_one_by_which_a_robot_lied_is_told_of_and_named_where_it_is_needed(tmp_path):
    lie = {"robot": 2, "kind": "algorithm", "algorithm": {"name": "no_such_law", "gain": 0.9}}
    text = toml({"faults.byzantine": [lie]}, base=made_up_runs.chain(N, M, 10))
    path = written(tmp_path / "run.mcap", scenario=text, codecs=Codecs.of(Sizes(M)))
    done = nrs("info", "--json", path)
    assert (done.returncode, json.loads(done.stdout)["byzantine"]) == (0, [2])
    done = nrs("replay", "--verify", "--agents-only", path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: faults.byzantine[0].{MESSAGE}")


def test_a_scenario_may_not_name_such_an_algorithm(tmp_path):
    (tmp_path / "a.toml").write_text(SCENARIO, "utf-8")
    done = nrs("check", tmp_path / "a.toml")
    assert done.returncode == 2
    assert "algorithm.name: expected one of dcea1, " in done.stderr


@pytest.mark.parametrize("name", ["nrs.State", "nrs.Mine.Sample"])
def test_a_schema_that_no_run_writes_is_one_line_of_every_command(tmp_path, name):
    odd = Schema(name, STATE.descriptor().replace(b"velocity", b"veloc ty"))
    path = written(tmp_path / "odd.mcap", schemas=[odd])
    for command in (
        ("info", path),
        ("export", path, "-o", tmp_path / "tables"),
        ("report", path, "-o", tmp_path / "run.html"),
        ("diff", path, path),
        ("scene", path, "-o", tmp_path / "scene.mcap"),
        ("replay", path, "--verify"),
    ):
        done = nrs(*command)
        assert done.returncode == 2, command
        assert done.stderr.startswith(f"error: {path}: schema '{name}'"), done.stderr
        assert "Traceback" not in done.stderr


OTHER_VERSIONS = {
    "algorithm.gamma": {"name": "dcea1", "alpha": 0.9, "beta": 1.1, "gamma": 0.5},
    "algorithm.beta": {"name": "dcea1", "alpha": 0.9},
}


@pytest.mark.parametrize(("field", "table"), OTHER_VERSIONS.items(), ids=OTHER_VERSIONS)
def test_one_of_another_version_is_read_and_what_differs_is_named(tmp_path, field, table):
    text = toml({"algorithm": table}, base=made_up_runs.chain(N, M, 10))
    path = written(tmp_path / "run.mcap", scenario=text)
    done = nrs("info", "--json", path)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["algorithm"]["parameters"] == {k: v for k, v in table.items() if k != "name"}
    assert found["theory"]["why_not"].startswith(f"{field}: ")
    assert nrs("report", path, "-o", tmp_path / "run.html").returncode == 0
    done = nrs("replay", "--verify", "--agents-only", path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {field}: ")
    assert "another version of dcea1 is installed than the recording is of" in done.stderr


MODULE = """from dataclasses import dataclass

from nrs_cosim.estimator_agents.dcea1 import FirstOrder


@dataclass(frozen=True)
class Theirs(FirstOrder):
    pass
"""


def test_the_package_that_it_was_of_is_in_the_recording_and_named_once_it_is_gone(
    tmp_path, monkeypatch
):
    site = tmp_path / "site"
    about = site / "their_laws-1.2.dist-info"
    about.mkdir(parents=True)
    (site / "their_laws.py").write_text(MODULE)
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: their-laws\nVersion: 1.2\n")
    (about / "entry_points.txt").write_text("[nrs.algorithms]\ntheirs = their_laws:Theirs\n")
    with monkeypatch.context() as here:
        here.syspath_prepend(str(site))
        outcome = engine.run(paper(SHORT, {"algorithm.name": "theirs"}), tmp_path / "run.mcap")
        with Reader(outcome.path) as reader:
            assert verify(reader, experiment_of(reader), plants=False).status == "identical"
    with Reader(outcome.path) as reader, pytest.raises(InputError) as raised:
        verify(reader, experiment_of(reader), plants=False)
    assert str(raised.value) == (
        "algorithm.name: 'theirs' is not installed as it was recorded; install their-laws 1.2 "
        "(their_laws:Theirs)"
    )
