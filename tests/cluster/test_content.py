"""FMUs go by content: a worker runs the very bytes that the orchestrator has, or says what to
do."""

import zipfile
from pathlib import Path

from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.plant_fmu.archives.archive import find_archive
from tests.cluster.remote_workers import Run, alone, paper_file
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
