"""What killed processes leave is removed by the next, and nothing that is held."""

import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from nrs_cosim.plant_fmu.folders import own_folder

HOLDER = """
import sys
from nrs_cosim.plant_fmu.folders import own_folder
with own_folder() as folder:
    (folder / "file").touch()
    print(folder, flush=True)
    sys.stdin.readline()
"""


@pytest.fixture(autouse=True)
def place(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    return tmp_path


def test_a_folder_ends_with_its_context(place):
    with own_folder() as one, own_folder() as two:
        assert {*place.iterdir()} == {one, two}
    assert [*place.iterdir()] == []


def test_the_folder_of_a_killed_process_is_removed_and_no_other(place):
    (place / "nrs-own-link").symlink_to(place / "kept")
    (place / "kept").mkdir()
    (place / "nrs-own-file").touch()
    kept = {*place.iterdir()}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen([sys.executable, "-c", HOLDER], **pipes) as process:
        held = Path(process.stdout.readline().strip())
        with own_folder() as own:
            assert {*place.iterdir()} == kept | {own, held}
        process.kill()
    assert held.exists()
    with own_folder() as own:
        assert {*place.iterdir()} == kept | {own}
