"""FMUs go by content: a worker runs the very bytes that the orchestrator has, or says what to
do."""

import zipfile
from pathlib import Path

import pytest

from nrs_cosim.bus.encryption import KeyPair
from nrs_cosim.bus.transport import Question
from nrs_cosim.orchestrator.cluster import supervision
from nrs_cosim.orchestrator.cluster.admission import Admission
from nrs_cosim.orchestrator.cluster.assignment import Assignment
from nrs_cosim.orchestrator.cluster.protocol import Hello
from nrs_cosim.orchestrator.cluster.supervision import Supervision, WorkerPolicy
from nrs_cosim.orchestrator.errors import WorkerError
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.plant_fmu.archives.archive import find_archive
from tests.cluster.remote_workers import Run, alone, paper_file
from tests.guard import GUARD
from tests.network.ports import free_port


def foreign_copy(path: Path) -> Path:
    """Write a bundled FMU with an entry more, so that it is nobody's that is known."""
    with (
        zipfile.ZipFile(find_archive("two_link_arm", Path()).path) as ours,
        zipfile.ZipFile(path, "w") as copy,
    ):
        for entry in ours.infolist():
            copy.writestr(entry, ours.read(entry))
        copy.writestr("documentation/note.txt", "of another hand")
    return path


def test_a_third_party_fmu_is_fetched_where_that_is_allowed(nrs, tmp_path):
    fmu = foreign_copy(tmp_path / "own.fmu")
    path = paper_file(tmp_path, 20, {"plant.fmu": "own.fmu"})
    file, meet = read_scenario(path), f"tcp/127.0.0.1:{free_port()}"
    digest = alone(file, tmp_path)
    elsewhere = {"NRS_CACHE": str(tmp_path / "elsewhere")}
    join = ("worker", "--insecure-tcp", "--connect", meet, "--name", "other")
    with Run(file, tmp_path / "run.mcap", listen=(meet,)) as run:
        wary = nrs(*join, environment=elsewhere)
        why = f"this worker has no FMU of SHA-256 {find_archive(str(fmu), Path()).sha256[:16]}"
        assert why in run.until(
            " open robots 1-6: "
        )  # cannot, or could not, when it is gone already
        status, printed = wary.end()
        assert (status, why in printed, "--allow-fmus" in printed) == (2, True, True), printed
        bold = nrs(*join, "--allow-fmus", environment=elsewhere)
        assert run.digest() == digest
        assert bold.end()[0] == 0
    (kept,) = (tmp_path / "elsewhere" / "by-sha256").iterdir()
    assert kept.read_bytes() == fmu.read_bytes()


def test_a_run_that_no_able_worker_joins_says_why_those_that_came_were_not(
    nrs, tmp_path, monkeypatch
):
    foreign_copy(tmp_path / "own.fmu")
    file = read_scenario(paper_file(tmp_path, 20, {"plant.fmu": "own.fmu"}))
    meet = f"tcp/127.0.0.1:{free_port()}"
    with Run(file, tmp_path / "run.mcap", listen=(meet,)) as run:
        join = ("worker", "--insecure-tcp", "--connect", meet, "--name", "left")
        wary = nrs(*join, environment={"NRS_CACHE": str(tmp_path / "elsewhere")})
        run.until(" open robots 1-6: ")
        assert wary.end()[0] == 2
        later = supervision.monotonic() + 2 * GUARD
        monkeypatch.setattr(supervision, "monotonic", lambda: later)
        said = "left came, and could not open robots: .* this worker has no FMU .* --allow-fmus"
        with pytest.raises(WorkerError, match=said):
            run.outcome()
    assert not (tmp_path / "run.mcap").exists()


def test_several_that_could_not_open_their_robots_are_named_with_each_reason_once():
    policy = WorkerPolicy(True, 0.0, print)
    unable = {"right": "no FMU", "left": "no FMU", "third": "no memory"}
    with pytest.raises(WorkerError) as error:
        Supervision(Assignment(6, 3), policy, None, unable=unable).look_after(0, False)
    assert str(error.value) == (
        "robots 1-6 had no worker for 0 s: left and right came, and could not open robots: no FMU; "
        "third came, and could not open robots: no memory; mend that, or start others"
    )


def test_a_worker_that_was_not_let_in_is_named_with_the_reason_when_none_came():
    slots = Assignment(3, 1)
    asked = Hello(version="0.0.0", incarnation="a", robots=None, public=KeyPair().public)
    question = Question("join", asked.written(), lambda _: None)
    Admission("run", None, {}, b"", slots).answer("left", question, 0.0)
    with pytest.raises(WorkerError, match=r"had no worker for 0 s: left was not let in: .*0\.0\.0"):
        Supervision(slots, WorkerPolicy(True, 0.0, print), None).look_after(0, False)


def test_a_bundled_model_is_built_there_to_the_same_bytes(nrs, tmp_path):
    file, meet = read_scenario(paper_file(tmp_path, 20)), f"tcp/127.0.0.1:{free_port()}"
    with Run(file, tmp_path / "run.mcap", listen=(meet,)) as run:
        elsewhere = {"NRS_CACHE": str(tmp_path / "elsewhere")}
        worker = nrs(
            "worker", "--insecure-tcp", "--connect", meet, "--name", "other", environment=elsewhere
        )
        assert run.digest() == alone(file, tmp_path)
        assert worker.end()[0] == 0
    (built,) = (tmp_path / "elsewhere").glob("*.fmu")
    assert built.read_bytes() == find_archive("two_link_arm", Path()).path.read_bytes()
