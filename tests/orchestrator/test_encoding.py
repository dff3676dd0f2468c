"""Names that are no UTF-8, and outputs that are not: a run is recorded, and its summary printed."""

import json
import os
import subprocess
import sys

import pytest

from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.cases import cases
from tests.command import nrs
from tests.scenarios import SHORT, toml, write

ODD = os.fsdecode(b"bad\xff")
"""A name as it comes from an archive of another encoding."""


@pytest.fixture
def odd(tmp_path):
    """Return the path of a scenario whose name is no UTF-8, in a folder whose name is none."""
    folder = tmp_path / ODD
    try:
        folder.mkdir()
    except OSError:
        pytest.skip("this file system takes no names but UTF-8")
    return write(folder / f"{ODD}.toml", SHORT)


def run(*arguments, encoding, cwd):
    """Run the command with an encoding of its output; return its status and what it printed."""
    environment = {**os.environ, "PYTHONIOENCODING": encoding}
    command = [sys.executable, "-m", "nrs_cosim.orchestrator", *map(str, arguments)]
    done = subprocess.run(command, cwd=cwd, env=environment, capture_output=True, check=False)
    return done.returncode, done.stdout.decode(encoding), done.stderr.decode(encoding)


@pytest.mark.parametrize("workers", [[], ["--workers", "2"]], ids=["alone", "workers"])
def test_a_name_that_is_not_utf8_is_recorded_with_escapes(odd, workers):
    recording = odd.parent / "run.mcap"
    done = nrs("run", odd, "-o", recording, *workers)
    assert done.returncode == 0, done.stderr
    result = json.loads(nrs("info", recording, "--json").stdout)
    assert result["name"] == r"bad\udcff"
    assert result["file"] == str(recording).encode(errors="backslashreplace").decode()
    json.dumps(result, ensure_ascii=False).encode()
    assert "identical" in nrs("replay", recording, "--verify").stdout
    new = odd.parent / "new.mcap"
    assert nrs("scene", recording, "-o", new).returncode == 0
    changed = nrs("replay", recording, "--algorithm", "alpha=0.8", "-o", odd.parent / "b.mcap")
    assert changed.returncode == 0, changed.stderr


def test_an_fmu_whose_path_is_not_utf8_is_refused_in_a_change(odd):
    recording = odd.parent / "run.mcap"
    assert nrs("run", odd, "-o", recording).returncode == 0
    (odd.parent / "arm.fmu").touch()
    done = nrs("replay", recording, "--plant", "plant.fmu=arm.fmu", cwd=odd.parent)
    assert done.returncode == 2
    assert "its path is no text in UTF-8; rename it" in done.stderr


@pytest.mark.parametrize("encoding", cases(["ascii", "latin-1", "utf-8"], ["ascii"]))
def test_a_result_is_printed_in_any_output_encoding(tmp_path, encoding):
    scenario = write(tmp_path / "räum_ε.toml", SHORT)
    status, printed, errors = run(
        "run", scenario, "-o", "räum_ε.mcap", encoding=encoding, cwd=tmp_path
    )
    assert (status, errors) == (0, "")
    expected = "räum_ε".encode(encoding, "backslashreplace").decode(encoding)
    assert f"run        {expected}: completed" in printed
    assert f"recording  {expected}.mcap" in printed
    status, _, errors = run("check", f"{scenario}.none", encoding=encoding, cwd=tmp_path)
    assert status == 2
    assert f"{expected}.toml.none: no such file" in errors


def test_a_name_that_is_not_utf8_can_be_printed(odd):
    for encoding in ("ascii", "utf-8"):
        status, _, errors = run("check", f"{odd}.none", encoding=encoding, cwd=odd.parent)
        assert status == 2
        assert r"bad\udcff.toml.none: no such file" in errors


def test_a_byte_order_mark_is_ignored(tmp_path):
    for name, mark in (("with", "\ufeff"), ("without", "")):
        (tmp_path / f"{name}.toml").write_text(mark + toml(SHORT), "utf-8")
    marked, plain = (read_scenario(tmp_path / f"{name}.toml") for name in ("with", "without"))
    assert marked.scenario == plain.scenario
    assert marked.text == f"\ufeff{plain.text}"
