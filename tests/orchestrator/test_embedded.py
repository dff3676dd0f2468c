"""A recording may hold its FMUs, which are run only where that is allowed, and by their hash."""

import hashlib
import json
import shutil
import zipfile
from dataclasses import dataclass
from pathlib import Path

import pytest

import nrs_cosim
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.plant_fmu.archives.archive import find_archive
from nrs_cosim.plant_fmu.bundled import builder
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import ASSETS
from nrs_cosim.recordings.schemas import about
from tests.cluster.remote_workers import digest_of
from tests.cluster.test_content import foreign_copy
from tests.command import nrs
from tests.orchestrator.test_assets import again
from tests.scenarios import SHORT, paper, write

OWN = {"plant.fmu": "own.fmu"}
ADVICE = "the recording has it, and --allow-fmus lets it run"


@dataclass(frozen=True)
class Ran:
    """A run that holds its FMU, whose file was deleted since, and a part of it."""

    fmu: Path
    content: bytes
    path: Path
    begun: Path
    digest: str


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    folder = tmp_path_factory.mktemp("embedded")
    fmu = foreign_copy(folder / "own.fmu")
    bundled = {"robots": [{"id": 3, "plant": {"fmu": "two_link_arm"}}]}
    own = write(folder / "own.toml", OWN, {"run.duration": 0.6}, bundled)
    scenario = nrs_cosim.Scenario.load(own)
    path, begun = folder / "run.mcap", folder / "begun.mcap"
    with nrs_cosim.run(scenario, path, embed_fmus=True) as recording:
        digest = recording.digest
    with Reader(path) as reader:
        experiment = experiment_of(reader)

    def watch(time_ns):
        if time_ns >= experiment.clock.t(3):
            raise Interrupted

    assert run(experiment, begun, watch=watch).status == "interrupted"
    content = fmu.read_bytes()
    fmu.unlink()
    return Ran(fmu, content, path, begun, digest)


@pytest.fixture(autouse=True, scope="module")
def cache(tmp_path_factory):
    """Give these tests a cache of their own, into which each bundled model is built once."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NRS_CACHE", str(folder))
        yield folder


@pytest.fixture(autouse=True)
def store(cache):
    """Return where FMUs are kept by their hash: nowhere yet."""
    shutil.rmtree(cache / "by-sha256", ignore_errors=True)
    return cache / "by-sha256"


def commands(ran, folder, *more):
    """Yield what runs the recorded FMU."""
    yield nrs("replay", ran.path, "--verify", *more)
    yield nrs("resume", ran.begun, "-o", folder / "rest.mcap", *more)
    yield nrs("replay", ran.path, "--algorithm", "beta=1.1", "-o", folder / "same.mcap", *more)
    plant = ("--plant", "robots=2,controller.kp=200.0")
    yield nrs("replay", ran.path, *plant, "-o", folder / "plant.mcap", *more)


def test_the_users_fmu_is_attached_and_the_bundled_one_is_not(ran):
    with Reader(ran.path) as reader:
        sha256 = hashlib.sha256(ran.content).hexdigest()
        assert reader.attachments.keys() - reader.metadata["nrs.urdfs"] == {
            "scenario.toml",
            f"{sha256}.fmu",
        }
        assert reader.attachments[f"{sha256}.fmu"] == ("application/zip", ran.content)
        records = {field: json.loads(text) for field, text in reader.metadata[ASSETS].items()}
    assert records == {
        "plant.fmu": {
            "name": "own.fmu",
            "attachment": f"{sha256}.fmu",
            "sha256": sha256,
            "source_sha256": sha256,
        }
    }


def test_no_command_runs_it_unless_that_is_allowed(ran, tmp_path, store):
    for done in commands(ran, tmp_path):
        assert done.returncode == 2, done.args
        (line,) = done.stderr.splitlines()
        assert "own.fmu: no such FMU" in line
        assert ADVICE in line
    assert not store.exists()
    assert nrs("replay", ran.path, "--verify", "--agents-only").returncode == 0
    assert nrs("info", ran.path).returncode == 0
    assert nrs("report", ran.path, "-o", tmp_path / "page.html").returncode == 0


def test_an_embedded_fmu_gives_the_same_run_without_its_file(ran, tmp_path, store):
    for done in commands(ran, tmp_path, "--allow-fmus"):
        assert done.returncode == 0, done.stderr
    for name in ("rest", "same", "plant"):
        assert digest_of(tmp_path / f"{name}.mcap") == ran.digest
        with Reader(ran.path) as one, Reader(tmp_path / f"{name}.mcap") as other:
            kept = [reader.attachments.keys() for reader in (one, other)]
            assert kept[0] == kept[1]
    (kept,) = store.iterdir()
    assert kept.read_bytes() == ran.content
    refused = nrs("replay", ran.path, "--verify")
    assert (refused.returncode, ADVICE in refused.stderr) == (2, True)


def test_workers_run_it_too(ran, tmp_path):
    done = nrs("resume", ran.begun, "-o", tmp_path / "rest.mcap", "--workers", "3", "--allow-fmus")
    assert done.returncode == 0, done.stderr
    assert digest_of(tmp_path / "rest.mcap") == ran.digest


def test_another_fmu_at_its_path_is_run_in_no_case(ran, tmp_path):
    with zipfile.ZipFile(foreign_copy(ran.fmu), "a") as other:
        other.writestr("documentation/another.txt", "of a third hand")
    try:
        for done in commands(ran, tmp_path):
            assert (done.returncode, ADVICE in done.stderr) == (2, True)
            assert "is not the FMU that the recording was made with" in done.stderr
        for done in commands(ran, tmp_path, "--allow-fmus"):
            assert done.returncode == 0, done.stderr
    finally:
        ran.fmu.unlink()
    assert digest_of(tmp_path / "rest.mcap") == ran.digest


def test_an_fmu_that_is_not_the_recorded_one_is_run_in_no_case(ran, tmp_path):
    """The attachment is another FMU with the right hash of its own, but the plants had another."""
    data = find_archive("two_link_arm", Path()).path.read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()

    def records(kept):
        record = json.loads(kept[ASSETS]["plant.fmu"]) | {"sha256": sha256}
        return {**kept, ASSETS: {"plant.fmu": json.dumps(record)}}

    def attachments(kept):
        return {n: ("application/zip", data) if n.endswith(".fmu") else c for n, c in kept.items()}

    path = again(ran.path, tmp_path / "other.mcap", attachments, records)
    done = nrs("replay", path, "--verify", "--allow-fmus")
    assert done.returncode == 2
    assert "own.fmu is not the FMU that the recording was made with" in done.stderr


def test_a_recording_says_which_plants_come_to_the_same_bits_on_any_machine(ran, tmp_path):
    by_library = {"plant.solver": "cvode"}
    for path, wanted in (
        (ran.path, {"own.fmu": False, "two_link_arm": True}),
        (run(paper(SHORT, by_library), tmp_path / "cvode.mcap").path, {"two_link_arm": False}),
    ):
        with Reader(path) as reader:
            assert {plant.fmu: plant.any_machine for plant in about(reader).run.plants} == wanted


def test_a_bundled_model_of_an_earlier_version_is_found_by_its_hash(tmp_path, monkeypatch):
    """Another build is as good as another version: other bytes, another key, the same name."""
    with monkeypatch.context() as earlier:
        earlier.setattr(builder, "FLAGS", (*builder.FLAGS, "-DEARLIER", "-O1"))
        path = run(paper(SHORT), tmp_path / "earlier.mcap").path
        built = builder.build("two_link_arm")
    assert builder.build("two_link_arm").read_bytes() != built.read_bytes()
    assert nrs("replay", path, "--verify").returncode == 0
    built.unlink()
    gone = nrs("replay", path, "--verify")
    assert gone.returncode == 2
    assert "two_link_arm is not the FMU that the recording was made with" in gone.stderr


def test_another_plant_in_its_place_is_not_recorded_as_it(ran, tmp_path):
    change = ("--plant", "plant.fmu=two_link_arm")
    done = nrs("replay", ran.path, *change, "-o", tmp_path / "bundled.mcap")
    assert done.returncode == 0, done.stderr
    with Reader(tmp_path / "bundled.mcap") as reader:
        assert reader.attachments.keys() - reader.metadata["nrs.urdfs"] == {"scenario.toml"}
        assert experiment_of(reader).assets == {}


def test_from_python_an_embedded_fmu_runs_where_allowed(ran):
    with pytest.raises(InputError, match=ADVICE):
        nrs_cosim.replay.verify(ran.path)
    assert nrs_cosim.replay.verify(ran.path, allow_fmus=True).status == "identical"
    with nrs_cosim.resume(ran.begun, allow_fmus=True) as rest:
        assert rest.digest == ran.digest
    change = {"controller.kp": 150.0}
    with nrs_cosim.replay.what_if(ran.path, change, robots=[2], allow_fmus=True) as stiff:
        assert stiff.status == "completed"


def test_without_the_option_no_fmu_is_recorded(tmp_path):
    foreign_copy(tmp_path / "own.fmu")
    own, there = write(tmp_path / "own.toml", OWN), tmp_path / "run.mcap"
    done = nrs("run", own, "--set", "run.duration=0.2", "-o", there)
    assert done.returncode == 0, done.stderr
    with Reader(there) as reader:
        assert reader.attachments.keys() == {"scenario.toml"}
