"""What a scenario names goes with it by content: its text and its files are needed no more."""

import hashlib
import json
import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import mcap.reader
import numpy as np
import pytest

import nrs_cosim
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cluster.protocol import AssetNote
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.errors import Interrupted, ScenarioError
from nrs_cosim.orchestrator.scenario.assets import TABLE, Asset
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.mcap.container import BEGIN
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from nrs_cosim.recordings.metadata import ASSETS, RUN
from tests.cluster.local_workers import LocalRun
from tests.cluster.remote_workers import Run, Worker, digest_of
from tests.command import nrs
from tests.network.ports import free_port
from tests.orchestrator.run_oracle import target
from tests.scenarios import PAPER_FILE, SHORT, tables, toml

EDGES = "source,sink,weight\n3,1,1\n2,1,0.5\n1,2,1\n0,3,1\n3,4,1\n1,4,1\n4,5,1\n3,5,1\n3,6,1\n"
OTHER = "sink,source\n1,0\n2,1\n3,2\n4,3\n5,4\n6,5\n"
WORDS = (
    '# "edges 0 that take the place of a file\'s name", ["what is times"]\n'
    '# edge_list = "edges" # it\'s what is positions\n'
)


def naming(edges="net.csv"):
    """Return a scenario's text that names files, with comments in the way."""
    rest = toml(SHORT, {"network": None, "target": None})
    return f"""{rest}{WORDS}
[network]
edges = "{edges}"   # who receives from whom

[target]
kind  =  'sampled'
file = "track.csv"
"""


def track(times):
    """Return the target of the paper's example as a table."""
    rows = (",".join(map(repr, (t, *map(float, target(t)[0])))) for t in times.tolist())
    return "\n".join(["t,position_1,position_2", *rows]) + "\n"


@dataclass(frozen=True)
class Ran:
    """A run whose files were deleted since, and a part of it."""

    folder: Path
    text: bytes
    path: Path
    begun: Path
    digest: str


def write(folder, edges="net.csv"):
    """Write a scenario with its files."""
    folder.mkdir(exist_ok=True)
    data = b"\xef\xbb\xbf" + "\r\n".join(naming(edges).split("\n")).encode()
    (folder / "named.toml").write_bytes(data)
    (folder / "net.csv").write_text(EDGES, "utf-8")
    (folder / "track.csv").write_text(track(np.arange(0, 1.04, 0.05)), "utf-8")
    return folder / "named.toml", data


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("assets")
    scenario_file, data = write(folder / "there")
    assert nrs("run", scenario_file, "-o", folder / "run.mcap").returncode == 0
    experiment = read_scenario(scenario_file)

    def watch(time_ns):
        if time_ns >= experiment.clock.t(4):
            raise Interrupted

    assert run(experiment, folder / "begun.mcap", watch=watch).status == "interrupted"
    shutil.rmtree(folder / "there")
    path = folder / "run.mcap"
    return Ran(folder, data, path, folder / "begun.mcap", digest_of(path))


def again(path, there, attachments=lambda kept: kept, records=lambda kept: kept):
    """Write a recording anew, rightly sealed, with other attachments or metadata."""
    with Reader(path) as reader:
        metadata = {name: dict(f) for name, f in reader.metadata.items() if name != BEGIN}
        head = {
            "version": "test",
            "channels": reader.channels,
            "schemas": reader.schemas,
            "metadata": records(metadata),
            "attachments": attachments(dict(reader.attachments)),
        }
        with Writer(there, **head) as writer:
            for batch in reader.batches():
                writer.write(batch)
            writer.finish("completed")
    return there


def test_the_scenario_text_is_recorded_verbatim_and_files_by_hash(ran):
    with ran.path.open("rb") as file:
        reader = mcap.reader.make_reader(file)
        attached = {a.name: (a.media_type, a.data) for a in reader.iter_attachments()}
        records = {m.name: m.metadata for m in reader.iter_metadata()}
    assert attached.pop("scenario.toml") == ("application/toml", ran.text)
    assets = {field: json.loads(text) for field, text in records["nrs.assets"].items()}
    assert {field: asset["name"] for field, asset in assets.items()} == {
        "network.edges": "net.csv",
        "target.file": "track.csv",
    }
    urdfs = records["nrs.urdfs"].keys()
    assert attached.keys() - urdfs == {asset["attachment"] for asset in assets.values()}
    for asset in assets.values():
        media_type, data = attached[asset["attachment"]]
        assert media_type == "text/csv"
        assert asset["sha256"] == hashlib.sha256(data).hexdigest()
        assert asset["attachment"] == f"{asset['sha256']}.csv"
    assert assets["network.edges"]["source_sha256"] == hashlib.sha256(EDGES.encode()).hexdigest()
    edges = attached[assets["network.edges"]["attachment"]][1].decode().splitlines()
    assert edges[:3] == ["source,sink,weight", "2,1,0.5", "3,1,1.0"]


def test_a_recording_lists_its_files(ran):
    done = nrs("info", ran.path, "--json")
    assets = json.loads(done.stdout)["assets"]
    assert assets.keys() == {"network.edges", "target.file"}
    assert assets["network.edges"]["source_sha256"] == hashlib.sha256(EDGES.encode()).hexdigest()
    shown = nrs("info", ran.path).stdout
    assert "network.edges net.csv, SHA-256" in " ".join(shown.split())


def test_working_with_a_recording_needs_no_scenario_files(ran, tmp_path):
    done = nrs("replay", ran.path, "--verify")
    assert (done.returncode, "identical" in done.stdout) == (0, True), done.stderr
    done = nrs("report", ran.path, "-o", tmp_path / "page.html")
    assert done.returncode == 0, done.stderr
    done = nrs("resume", ran.begun, "-o", tmp_path / "rest.mcap")
    assert done.returncode == 0, done.stderr
    assert digest_of(tmp_path / "rest.mcap") == ran.digest


@pytest.mark.parametrize(
    ("option", "change", "key"),
    [("--algorithm", "beta=0.9", "algorithm.beta=0.9"), ("--plant",) + 2 * ("controller.kp=150",)],
)
def test_a_what_if_equals_a_fresh_run_without_the_files(ran, tmp_path, option, change, key):
    changed, fresh = tmp_path / "changed.mcap", tmp_path / "fresh.mcap"
    done = nrs("replay", ran.path, option, change, "-o", changed)
    assert done.returncode == 0, done.stderr
    assert nrs("replay", changed, "--verify").returncode == 0
    scenario_file, _ = write(tmp_path / "fresh")
    assert nrs("run", scenario_file, "--set", key, "-o", fresh).returncode == 0
    assert digest_of(changed) == digest_of(fresh)


def test_paths_in_a_recording_are_not_read(ran, tmp_path):
    """Where the files were are now others, with which the run would be another."""
    there = ran.folder / "there"
    write(there)
    (there / "net.csv").write_text(OTHER, "utf-8")
    (there / "track.csv").write_text("t,position_1,position_2\n0,0,0\n9,0,0\n", "utf-8")
    try:
        with Reader(ran.path) as reader:
            experiment = experiment_of(reader)
        assert len(experiment.topologies.links.source) == EDGES.count("\n") - 1
        assert nrs("replay", ran.path, "--verify").returncode == 0
        assert nrs("resume", ran.begun, "-o", tmp_path / "rest.mcap").returncode == 0
    finally:
        shutil.rmtree(there)
    assert digest_of(tmp_path / "rest.mcap") == ran.digest
    with Reader(ran.path) as one, Reader(tmp_path / "rest.mcap") as other:
        assert one.attachments == other.attachments
        assert one.metadata[ASSETS] == other.metadata[ASSETS]


def test_three_workers_of_this_machine_have_the_assets_of_the_orchestrator(ran, tmp_path):
    scenario_file, _ = write(tmp_path / "here")
    experiment = read_scenario(scenario_file)
    shutil.rmtree(tmp_path / "here")
    assert LocalRun(experiment, 3).run(tmp_path / "run.mcap").status == "completed"
    assert digest_of(tmp_path / "run.mcap") == ran.digest


def test_a_worker_from_elsewhere_is_sent_them(ran, tmp_path):
    scenario_file, _ = write(tmp_path / "here")
    experiment, meet = read_scenario(scenario_file), f"tcp/127.0.0.1:{free_port()}"
    shutil.rmtree(tmp_path / "here")
    with Run(experiment, tmp_path / "run.mcap", listen=(meet,)) as directed:
        worker = Worker(meet, "left")
        assert directed.digest() == ran.digest
        worker.end()


def test_a_worker_rejects_an_asset_of_another_hash():
    asset = Asset.of("net.csv", "0" * 64, TABLE, EDGES.encode())
    note = AssetNote.of(asset)
    assert note.asset("network.edges") == asset
    other = note.model_copy(update={"content": OTHER})
    with pytest.raises(InputError, match=r"network\.edges: net\.csv: expected content of SHA-256"):
        other.asset("network.edges")


def edges_of(reader):
    return json.loads(reader.metadata[ASSETS]["network.edges"])["attachment"]


WRONG = {
    "missing": (lambda kept, name: kept.pop(name), "expected this attachment, which is network.e"),
    "cut": (
        lambda kept, name: kept.update({name: ("text/csv", kept[name][1][:-3])}),
        "expected the content that network.edges had, of SHA-256 ",
    ),
    "with other content": (
        lambda kept, name: kept.update({name: ("text/csv", OTHER.encode())}),
        "expected the content that network.edges had, of SHA-256 ",
    ),
}


@pytest.mark.parametrize("which", WRONG)
def test_an_attachment_that_is_not_the_runs_is_one_clear_error(ran, tmp_path, which):
    change, message = WRONG[which]
    with Reader(ran.path) as reader:
        name = edges_of(reader)

    def changed(kept):
        change(kept, name)
        return kept

    path = again(ran.path, tmp_path / "wrong.mcap", changed)
    for command in (
        ["info", path],
        ["replay", path, "--verify"],
        ["replay", path, "--algorithm", "beta=0.9", "-o", tmp_path / "new.mcap"],
        ["resume", path, "-o", tmp_path / "new.mcap"],
        ["report", path, "-o", tmp_path / "page.html"],
        ["export", path, "-o", tmp_path / "tables"],
    ):
        done = nrs(*command)
        assert done.returncode == 2, command
        (line,) = done.stderr.splitlines()
        assert line.startswith(f"error: {path}: {name}: {message}")


def with_record(field, **fields):
    """Return metadata in which an asset's record has other fields."""

    def changed(kept):
        record = json.loads(kept[ASSETS][field])
        return {**kept, ASSETS: {**kept[ASSETS], field: json.dumps({**record, **fields})}}

    return changed


def without(field):
    def changed(kept):
        left = {name: text for name, text in kept[ASSETS].items() if name != field}
        return {**kept, ASSETS: left}

    return changed


def beside(field, of):
    return lambda kept: {**kept, ASSETS: {**kept[ASSETS], field: kept[ASSETS][of]}}


RECORDS = {
    "no hash": (with_record("target.file", sha256="x"), "nrs.assets: target.file.sha256: string"),
    "no json": (
        lambda kept: {**kept, ASSETS: {"target.file": "{"}},
        "nrs.assets: target.file: invalid JSON",
    ),
    "of another name": (
        with_record("target.file", name="other.csv"),
        "scenario.toml: target.file: 'track.csv' is read where a scenario file is, and did not",
    ),
    "left out": (
        without("network.edges"),
        "scenario.toml: network.edges: 'net.csv' is read where a scenario file is, and did not",
    ),
    "of a field that names nothing": (
        beside("network.graphml", "network.edges"),
        "scenario.toml: names no network.graphml, of which nrs.assets has an asset",
    ),
}


@pytest.mark.parametrize("which", RECORDS)
def test_a_record_of_assets_that_no_run_wrote_is_refused_by_name(ran, tmp_path, which):
    records, message = RECORDS[which]
    path = again(ran.path, tmp_path / "wrong.mcap", records=records)
    done = nrs("info", path)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"error: {path}: {message}")


BAD = {
    "no table": (b"PK\3\4\xff", "net.csv: cannot be read: it is no text in UTF-8"),
    "a loop": (b"source,sink\n0,1\n1,1\n", "net.csv: line 3: expected another source"),
    "a tree without root": (b"source,sink\n1,2\n2,1\n", "expected a spanning tree rooted"),
}


@pytest.mark.parametrize("which", BAD)
def test_attachments_are_validated_like_files(ran, tmp_path, which):
    data, message = BAD[which]
    with Reader(ran.path) as reader:
        name = edges_of(reader)
    path = again(
        ran.path,
        tmp_path / "wrong.mcap",
        lambda kept: {**kept, name: ("text/csv", data)},
        with_record("network.edges", sha256=hashlib.sha256(data).hexdigest()),
    )
    done = nrs("info", path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {path}: scenario.toml: ")
    assert message in done.stderr


def test_a_scenario_without_files_attaches_its_text_and_the_robots_urdf(tmp_path):
    path = tmp_path / "a.mcap"
    done = nrs("run", PAPER_FILE, "--set", "run.duration=0.3", "-o", path)
    assert done.returncode == 0, done.stderr
    with Reader(path) as reader:
        assert reader.attachments.keys() == {"scenario.toml", *reader.metadata["nrs.urdfs"]}
        assert ASSETS not in reader.metadata


class TestFromPython:
    def test_a_scenario_keeps_the_files_as_first_read(self, tmp_path):
        scenario_file, data = write(tmp_path / "here")
        scenario = nrs_cosim.Scenario.load(scenario_file)
        assert scenario.to_toml().encode() == data
        (tmp_path / "here" / "net.csv").write_text("no table", "utf-8")
        other = scenario.replace({"algorithm.alpha": 0.8})
        assert other["algorithm.alpha"] == 0.8
        assert other["network.edges"] == "net.csv"
        with pytest.raises(InputError, match=r"network\.edges: net\.csv: expected the columns"):
            scenario.replace({"network.edges": "net.csv"})
        (tmp_path / "here" / "other.csv").write_text(OTHER, "utf-8")
        chain = scenario.replace({"network.edges": "other.csv"})
        assert len(chain._experiment.topologies.links.source) == 6

    def test_a_recordings_scenario_is_changed_and_run_without_its_files(self, ran, tmp_path):
        with nrs_cosim.Recording(ran.path) as recording:
            scenario = recording.to_scenario()
        assert scenario.to_toml().encode() == ran.text
        with nrs_cosim.run(scenario, tmp_path / "same.mcap") as recording:
            assert recording.digest == ran.digest
        short = scenario.replace({"run.duration": 0.5})
        with nrs_cosim.run(short, tmp_path / "short.mcap") as recording:
            assert recording.ticks == 5
        with pytest.raises(InputError, match=r"network\.edges: net\.csv: no such file"):
            nrs_cosim.Scenario.parse(scenario.to_toml(), folder=tmp_path)

    def test_an_fmu_is_run_again_where_the_scenario_was_read_and_not_of_a_recording(self, tmp_path):
        mover = {
            "kind": "fmu",
            "fmu": "two_link_arm",
            "parameters": {"q": [0.3, 0.0]},
            "variables": {"position": "q", "velocity": "qd"},
        }
        scenario = nrs_cosim.Scenario(tables({"run.duration": 0.3, "target": mover}))
        longer = scenario.replace({"run.duration": 0.6})
        assert longer._experiment.scenario.target.times[-1] == 0.6
        with nrs_cosim.run(scenario, tmp_path / "run.mcap") as recording:
            recorded = recording.to_scenario()
        assert recorded.replace({"algorithm.alpha": 0.8}).joints == 2
        with pytest.raises(
            InputError, match=r"target\.fmu: its samples lack the sampling time 0\.4 s"
        ):
            recorded.replace({"run.duration": 0.6})
        longer = ("--set", "run.duration=0.6", "-o", tmp_path / "longer.mcap")
        done = nrs("resume", tmp_path / "run.mcap", *longer)
        assert done.returncode == 2
        assert "target.fmu: its samples lack the sampling time 0.4 s; run the scen" in done.stderr


def test_recordings_of_one_content_differ_in_nothing_wherever_it_was(ran, tmp_path):
    scenario_file, _ = write(tmp_path / "here", "copy.csv")
    (tmp_path / "here" / "net.csv").rename(tmp_path / "here" / "copy.csv")
    assert nrs("run", scenario_file, "-o", tmp_path / "same.mcap").returncode == 0
    done = nrs("diff", ran.path, tmp_path / "same.mcap", "--json")
    assert json.loads(done.stdout)["same"] is True
    (tmp_path / "here" / "copy.csv").write_text(OTHER, "utf-8")
    assert nrs("run", scenario_file, "-o", tmp_path / "other.mcap").returncode == 0
    done = nrs("diff", ran.path, tmp_path / "other.mcap", "--json")
    found = json.loads(done.stdout)
    assert (done.returncode, found["same"]) == (1, False)
    hashes = [hashlib.sha256(text.encode()).hexdigest() for text in (EDGES, OTHER)]
    assert found["fields"] == {
        "network.edges": [f"net.csv, SHA-256 {hashes[0]}", f"copy.csv, SHA-256 {hashes[1]}"]
    }


def test_a_changed_scenario_reads_the_file_that_the_change_names(tmp_path):
    scenario_file, _ = write(tmp_path / "here")
    (tmp_path / "here" / "other.csv").write_text(OTHER, "utf-8")
    there = tmp_path / "run.mcap"
    done = nrs("run", scenario_file, "--set", "network.edges=other.csv,run.seed=7", "-o", there)
    assert done.returncode == 0, done.stderr
    with Reader(there) as reader:
        experiment = experiment_of(reader)
        assert reader.metadata[RUN]["seed"] == "7"
    assert len(experiment.topologies.links.source) == 6
    assert experiment.assets["network.edges"].name == "other.csv"
    for line in WORDS.splitlines():
        assert line in experiment.text


def test_an_asset_too_large_for_a_recording_is_refused_before_the_run(tmp_path, monkeypatch):
    scenario_file, _ = write(tmp_path / "here")
    experiment = read_scenario(scenario_file)
    size = len(experiment.assets["network.edges"].content)
    monkeypatch.setattr("nrs_cosim.orchestrator.engine.attachments.MOST_ATTACHED", size - 1)
    with pytest.raises(ScenarioError, match=rf"network\.edges: net\.csv: .* got {size}"):
        run(experiment, tmp_path / "run.mcap")
    assert not (tmp_path / "run.mcap").exists()


def test_replacing_fmus_keeps_the_derived_values(ran):
    with Reader(ran.path) as reader:
        experiment = experiment_of(reader)
    clock, links = experiment.clock, experiment.topologies
    other = experiment.but(fmus={"a": Path("b")})
    assert other.clock is clock
    assert other.topologies is links
    assert other == replace(experiment, fmus={"a": Path("b")})
