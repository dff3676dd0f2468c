"""Building is reproducible, safe to interrupt and to repeat, and says what is missing."""

import os
import re
import shutil
import subprocess
import zipfile
from concurrent.futures import ThreadPoolExecutor
from ctypes import CDLL
from pathlib import Path

import fmpy
import pytest

from nrs_cosim.plant_fmu.bundled import builder
from nrs_cosim.plant_fmu.bundled.builder import FLAGS, build, build_library, write
from nrs_cosim.plant_fmu.cache import cache_folder
from nrs_cosim.plant_fmu.errors import FmuError
from tests.cases import cases

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache that is not the user's."""
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def binary(fmu: Path) -> bytes:
    with zipfile.ZipFile(fmu) as archive:
        (name,) = (name for name in archive.namelist() if name.startswith("binaries/"))
        return archive.read(name)


@pytest.mark.parametrize("fmi", cases([2, 3], [3]))
def test_a_rebuild_is_the_same_bytes(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fmi: int
) -> None:
    one = build("planar_robot", fmi)
    assert one.parent == cache
    elsewhere = tmp_path / "temporary files"
    elsewhere.mkdir()
    monkeypatch.setenv("TMPDIR", str(elsewhere))
    monkeypatch.setattr("tempfile.tempdir", None)
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "other"))
    other = build("planar_robot", fmi)
    assert other != one
    assert other.name == one.name
    assert other.read_bytes() == one.read_bytes()
    assert not list(elsewhere.iterdir())


def kept_in(cache: Path) -> list[Path]:
    """Return the files of a cache, each of which has its digest beside it, and nothing else."""
    kept = sorted(cache.iterdir())
    files = [path for path in kept if path.suffix != ".sha256"]
    assert kept == sorted([*files, *(path.with_name(f"{path.name}.sha256") for path in files)])
    return files


def test_a_cached_model_is_not_rebuilt(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = build("planar_robot")
    monkeypatch.setenv("PATH", "")
    assert build("planar_robot") == path
    assert kept_in(cache) == [path]


def test_a_library_is_cached_by_its_content(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sources = [{"f.c": b"int f(void);\nint f(void) { return %d; }\n" % i} for i in range(2)]
    monkeypatch.setattr(builder, "FLAGS", tuple(f for f in FLAGS if "visibility" not in f))
    paths = [build_library("f", files) for files in sources]
    assert [CDLL(str(path)).f() for path in paths] == [0, 1]
    monkeypatch.setenv("PATH", "")
    assert [build_library("f", files) for files in sources] == paths
    assert kept_in(cache) == sorted(paths)


def test_all_code_that_writes_a_bundled_model_decides_where_it_is_kept() -> None:
    folder = Path(builder.__file__).parent
    for name in ("c_source", "documentation", "model_description", "declaration"):
        text = (folder / f"{name}.py").read_text(encoding="utf-8")
        used = set(re.findall(r"from nrs_cosim\.(\S+) import", text))
        assert {one for one in used if ".bundled." not in one} <= {"plant_fmu.unit_names"}


def test_concurrent_builds_do_not_interfere(cache: Path) -> None:
    with ThreadPoolExecutor(4) as pool:
        paths = set(pool.map(build, ["planar_robot"] * 4))
    assert kept_in(cache) == list(paths)
    with zipfile.ZipFile(paths.pop()) as archive:
        assert archive.testzip() is None


def test_an_fmu_can_be_built_from_its_own_sources(tmp_path: Path) -> None:
    for fmi in (2, 3):
        path = build("two_link_arm", fmi)
        folder = tmp_path / str(fmi)
        fmpy.extract(path, unzipdir=folder)
        (configuration,) = fmpy.read_model_description(folder).buildConfigurations
        units = configuration.sourceFileSets[0].sourceFiles
        command = ["cc", *FLAGS, *units, "-o", "library", "-lm"]
        subprocess.run(command, cwd=folder / "sources", check=True)
        assert (folder / "sources" / "library").read_bytes() == binary(path)


def test_the_binary_contains_no_local_paths(tmp_path: Path) -> None:
    for name in ("planar_robot", "two_link_arm"):
        library = tmp_path / name
        library.write_bytes(binary(build(name)))
        strings = set(re.findall(rb"[ -~]{4,}", library.read_bytes()))
        for folder in (Path.home(), Path.cwd(), Path("/tmp"), Path(builder.__file__).parent):
            assert not [s for s in strings if bytes(folder) + b"/" in s]
        functions = CDLL(str(library))
        assert hasattr(functions, "fmi3DoStep")
        assert not hasattr(functions, "core_step")
        assert not hasattr(functions, "model_derivatives")


def test_write_copies_the_fmu(tmp_path: Path) -> None:
    write("planar_robot", 2, tmp_path / "mine.fmu")
    assert (tmp_path / "mine.fmu").read_bytes() == build("planar_robot", 2).read_bytes()


def test_an_unknown_model_names_the_known_ones() -> None:
    with pytest.raises(FmuError) as caught:
        build("two_link_arms")
    assert str(caught.value) == ("no bundled model 'two_link_arms'; did you mean 'two_link_arm'?")
    with pytest.raises(FmuError, match="fmi: expected 2 or 3, got 1"):
        build("two_link_arm", 1)


def test_a_missing_compiler_says_what_to_install(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("nrs_cosim.plant_fmu.bundled.compiler.has_zig", lambda: False)
    with pytest.raises(FmuError, match="sudo apt install gcc libc6-dev"):
        build("two_link_arm")
    monkeypatch.setenv("CC", "icc -fast")
    with pytest.raises(FmuError, match="looked for CC=icc"):
        build("two_link_arm")
    assert not cache.exists()


def test_a_failed_build_shows_the_compilers_error_and_leaves_no_file(
    cache: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(builder, "FLAGS", (*FLAGS, "-DSTATES=4"))
    with pytest.raises(FmuError, match=r"two_link_arm: cc failed:\n.*error: "):
        build("two_link_arm")
    assert not cache.exists()


def test_an_unwritable_cache_is_reported(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("NRS_CACHE", str(tmp_path / "file"))
    with pytest.raises(FmuError, match="set NRS_CACHE to another folder"):
        build("planar_robot")
    assert not cache.exists()


@pytest.mark.skipif(os.name != "posix", reason="XDG is of Unix")
def test_the_cache_is_in_the_users_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NRS_CACHE", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    assert cache_folder() == Path("/cache/nrs-cosim")
    monkeypatch.delenv("XDG_CACHE_HOME")
    assert cache_folder() == Path.home() / ".cache" / "nrs-cosim"
