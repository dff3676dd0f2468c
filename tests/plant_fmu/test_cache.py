"""The cache is input: only what is this user's and whole is loaded; all else is made again."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from nrs_cosim.plant_fmu import cache as caching
from nrs_cosim.plant_fmu.archives.archive import find_archive
from nrs_cosim.plant_fmu.bundled import builder
from nrs_cosim.plant_fmu.bundled.builder import build, build_library
from nrs_cosim.plant_fmu.cache import cache_folder
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.native.batch_calls import SOURCES, load_native
from tests.cases import cases

ROOT = Path(__file__).parents[2]
NOBODY = 65534
PLANTED = b"""
#include <stdio.h>
__attribute__((constructor)) static void planted(void) { fputs("planted code ran\\n", stderr); }
"""
SCENARIO = """
import sys
from pathlib import Path
from nrs_cosim.orchestrator.cli.main import main
from tests.cases import cases
text = Path(sys.argv[1]).read_text("utf-8").replace("duration = 30.0", "duration = 1.0")
Path("s.toml").write_text(text, "utf-8")
sys.argv = ["nrs", "run", "s.toml", "-o", "out.mcap"]
main()
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty cache that is not the user's."""
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "cache"))
    load_native.cache_clear()
    yield tmp_path / "cache"
    load_native.cache_clear()


@pytest.fixture
def compiled(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What is compiled from now on, by name."""
    made: list[str] = []
    compiling = builder._compile

    def compile_(name: str, *given: Any) -> bytes:
        made.append(name)
        return compiling(name, *given)

    monkeypatch.setattr(builder, "_compile", compile_)
    return made


def library() -> Path:
    return build_library("rounds", {file.name: file.read_bytes() for file in SOURCES})


def flipped(data: bytes) -> bytes:
    at = len(data) // 2
    return data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :]


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "truncated": lambda data: data[:9000],
    "emptied": lambda _: b"",
    "flipped": flipped,
    "another": lambda _: b"PK\x03\x04 or what not",
}


MAKES = {"fmu": lambda: build("two_link_arm"), "so": library}
DAMAGED = [(make, damage) for make in MAKES for damage in DAMAGES]


@pytest.mark.parametrize(("make", "damage"), cases(DAMAGED, DAMAGED[4:5]))
def test_a_damaged_cache_file_is_rebuilt(
    cache: Path,
    compiled: list[str],
    make: str,
    damage: str,
) -> None:
    path = MAKES[make]()
    whole = path.read_bytes()
    assert MAKES[make]() == path
    assert len(compiled) == 1
    path.write_bytes(DAMAGES[damage](whole))
    assert MAKES[make]() == path
    assert path.read_bytes() == whole
    assert len(compiled) == 2
    path.with_name(f"{path.name}.sha256").unlink()
    assert MAKES[make]().read_bytes() == whole
    assert len(compiled) == 3
    assert cache in path.parents


def test_an_fmu_changed_in_the_cache_is_not_trusted(cache: Path) -> None:
    path = build("two_link_arm")
    assert find_archive("two_link_arm", Path()).ours
    planted = path.with_name("two_link_arm-fmi3-planted.fmu")
    planted.write_bytes(path.read_bytes() + b"more")
    os.chown(planted, NOBODY, NOBODY)
    assert not find_archive(str(planted), Path()).ours
    assert cache in path.parents


needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="giving a file away needs root")


def run(tmp_path: Path) -> "subprocess.CompletedProcess[str]":
    """Run a scenario in a process of its own, which damaged code would end."""
    return subprocess.run(
        [sys.executable, "-c", SCENARIO, str(ROOT / "scenarios" / "paper_first_order.toml")],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        check=False,
        capture_output=True,
        text=True,
    )


@pytest.mark.parametrize("damage", cases(["truncated", "emptied"], ["truncated"]))
@pytest.mark.usefixtures("cache")
def test_a_run_rebuilds_damaged_cached_code(tmp_path: Path, damage: str) -> None:
    path = library()
    whole = path.read_bytes()
    path.write_bytes(DAMAGES[damage](whole))
    done = run(tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert path.read_bytes() == whole


@needs_root
@pytest.mark.usefixtures("cache")
def test_code_cached_by_another_user_is_not_run(tmp_path: Path) -> None:
    path = library()
    planted = build_library("planted", {"planted.c": PLANTED})
    for suffix in ("", ".sha256"):
        Path(f"{planted}{suffix}").replace(f"{path}{suffix}")
        os.chown(f"{path}{suffix}", NOBODY, NOBODY)
    done = run(tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert path.stat().st_uid == os.geteuid()
    assert load_native()


@needs_root
@pytest.mark.parametrize("mode", [0o1777, 0o755])
def test_a_cache_folder_of_another_user_is_refused_in_one_line(
    cache: Path, tmp_path: Path, mode: int
) -> None:
    library()
    cache.chmod(mode)
    os.chown(cache, NOBODY, NOBODY)
    done = run(tmp_path)
    refused = f"{cache}: belongs to another user (uid {NOBODY}), who could put code there"
    assert done.returncode == 2
    (line,) = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
    assert refused in line
    assert line.endswith("set NRS_CACHE to a folder of your own")
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("mode", [0o1777, 0o770, 0o702])
def test_a_cache_folder_writable_by_others_is_refused(cache: Path, mode: int) -> None:
    for folder in (cache, cache / "by-sha256"):
        folder.mkdir()
        folder.chmod(mode)
        with pytest.raises(FmuError, match=rf"others? users may write there \(mode {mode:o}\)"):
            caching.stored(f"{folder.relative_to(cache)}/x")
        with pytest.raises(FmuError, match="chmod go-w it, or set NRS_CACHE to another folder"):
            caching.keep(f"{folder.relative_to(cache)}/x", b"x")
        folder.chmod(0o700)


def test_a_cached_link_or_file_writable_by_others_is_ignored(cache: Path) -> None:
    path = caching.keep("x", b"x")
    assert caching.stored("x") == path
    path.chmod(0o666)
    assert caching.stored("x") is None
    path.rename(cache / "y")
    path.symlink_to(cache / "y")
    (cache / "y").chmod(0o600)
    assert caching.stored("x") is None


def test_a_new_cache_is_only_accessible_to_the_user(cache: Path) -> None:
    caching.keep("by-sha256/x", b"x")
    assert [path.stat().st_mode & 0o777 for path in (cache, cache / "by-sha256")] == [0o700] * 2


def test_a_cache_file_is_synced_before_it_is_renamed(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    synced: list[str] = []
    sync = os.fsync

    def watched(descriptor: int) -> None:
        sync(descriptor)
        synced.append(min(path.suffix for path in cache.iterdir()))

    monkeypatch.setattr(os, "fsync", watched)
    caching.keep("x.so", b"x")
    assert synced == [".part", ".part"]
    assert sorted(path.name for path in cache.iterdir()) == ["x.so", "x.so.sha256"]


@pytest.mark.parametrize("chosen", ["", "relative", "./cache", "~/cache"])
def test_a_relative_xdg_folder_is_ignored(monkeypatch: pytest.MonkeyPatch, chosen: str) -> None:
    """XDG Base Directory Specification: a relative path is invalid, and is to be ignored."""
    monkeypatch.delenv("NRS_CACHE", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("HOME", "/home/somebody")
    monkeypatch.setenv("XDG_CACHE_HOME", chosen)
    assert cache_folder() == Path("/home/somebody/.cache/nrs-cosim")


def test_without_a_home_the_named_cache_is_used(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def none() -> Path:
        raise RuntimeError("Could not determine home directory.")

    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(Path, "home", none)
    monkeypatch.setenv("NRS_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("NRS_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "nrs-cosim"
    monkeypatch.delenv("XDG_CACHE_HOME")
    with pytest.raises(FmuError, match="this user has no home folder; set NRS_CACHE to a folder"):
        cache_folder()
