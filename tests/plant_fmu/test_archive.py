"""An archive from a stranger is read, or refused with its cause; it never does anything else."""

import os
import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Event
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import pytest
from fmpy.fmi3 import FMU3Slave

from nrs_cosim.plant_fmu.archives import entries
from nrs_cosim.plant_fmu.archives.archive import find_archive, open_archive, unpacked
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi import library
from nrs_cosim.plant_fmu.fmi.library import Library
from tests.guard import GUARD, VAIN
from tests.plant_fmu.rewritten_fmus import NAME, description


def refused(path: Path) -> str:
    with pytest.raises(FmuError) as error:
        open_archive(path, "arm.fmu")
    assert str(error.value).startswith("arm.fmu: ")
    return str(error.value).removeprefix("arm.fmu: ")


def with_entry(path: Path, entry: ZipInfo | str, content: bytes = b"") -> Path:
    """Write the two-link arm's archive with one entry more."""
    path.write_bytes(build("two_link_arm").read_bytes())
    with ZipFile(path, "a") as archive:
        archive.writestr(entry, content)
    return path


# What is sound


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_archive_is_unpacked_and_its_folder_removed(temporary, fmi):
    here = Path.cwd()
    archive = open_archive(build("two_link_arm", fmi))
    assert (archive.name, archive.fmi_version) == ("two_link_arm", f"{fmi}.0")
    assert archive.kinds == ("CoSimulation", "ModelExchange")
    with unpacked(archive) as folder:
        assert folder.parent == temporary
        with ZipFile(archive.path) as content:
            expected = {name: content.read(name) for name in content.namelist()}
        files = {str(p.relative_to(folder)): p for p in folder.rglob("*") if p.is_file()}
        assert {name: file.read_bytes() for name, file in files.items()} == expected
    assert not list(temporary.iterdir())
    assert Path.cwd() == here


def test_threads_that_load_together_keep_the_working_directory(monkeypatch):
    """The second comes while the first is in its library's folder, unless it is made to wait."""
    here, archive, seen = Path.cwd(), open_archive(build("two_link_arm")), []
    first, second = Event(), Event()

    def begun(**options: str) -> FMU3Slave:
        seen.append(Path.cwd())
        os.chdir(options["unzipDirectory"])
        (second if first.is_set() else first).set()
        second.wait(VAIN)
        return FMU3Slave(**options)

    def load(turn: int) -> None:
        assert not turn or first.wait(GUARD)
        with unpacked(archive) as folder, Library(archive, folder, "CoSimulation"):
            pass

    monkeypatch.setattr(library, "_loader", lambda *_which: begun)
    with ThreadPoolExecutor(2) as threads:
        list(threads.map(load, range(2)))
    assert [*seen, Path.cwd()] == [here] * 3


def test_an_interrupt_removes_the_unpacked_folder(temporary):
    archive = open_archive(build("two_link_arm"))
    with suppress(KeyboardInterrupt), unpacked(archive) as folder:
        assert list(temporary.iterdir()) == [folder]
        raise KeyboardInterrupt
    assert not list(temporary.iterdir())


def test_an_archive_that_has_changed_is_not_unpacked(tmp_path, temporary):
    path = with_entry(tmp_path / "arm.fmu", "resources/a.txt")
    archive = open_archive(path, "arm.fmu")
    with_entry(path, "resources/b.txt")
    with (
        pytest.raises(FmuError, match=r"arm\.fmu: has changed since it was read"),
        unpacked(archive),
    ):
        pass
    assert not list(temporary.iterdir())


# What is refused


def test_a_file_not_named_fmu_is_refused(tmp_path):
    (tmp_path / "base.toml").touch()
    (tmp_path / "two_link_arm").touch()
    with pytest.raises(FmuError, match=r"^base\.toml: is not an FMU: its name does not end with"):
        find_archive("base.toml", tmp_path)
    assert find_archive("two_link_arm", tmp_path).name == "two_link_arm"


def test_a_file_that_is_no_archive_is_refused(tmp_path):
    path = tmp_path / "arm.fmu"
    assert refused(path) == f"no such FMU in {tmp_path}"
    assert refused(tmp_path).startswith("cannot be read: ")
    for content in (b"", b"PK\5\6", b"none", build("two_link_arm").read_bytes()[:-30]):
        path.write_bytes(content)
        assert refused(path).startswith("is not an FMU: it is not a zip archive, or a damaged one")
    ZipFile(path, "w").close()
    assert refused(path) == "is not an FMU: it has no modelDescription.xml"


@pytest.mark.parametrize(
    "name", ["/etc/x", "C:/x", "C:x", "a\\b", "resources/../../x", "..", "../x", "resources/x:y"]
)
def test_an_entry_outside_the_archives_folder_is_refused(tmp_path, name):
    entry = ZipInfo("placeholder")
    entry.filename = name
    message = refused(with_entry(tmp_path / "arm.fmu", entry))
    assert re.match(
        r"is refused: its entry .* has a path that (is not relative|leads out)", message
    )


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (
            {"external_attr": 0o120777 << 16},
            "is neither a file nor a folder but a link or a device",
        ),
        (
            {"external_attr": 0o020666 << 16},
            "is neither a file nor a folder but a link or a device",
        ),
        ({"compress_type": ZIP_BZIP2}, "is compressed by another method than deflate"),
    ],
)
def test_links_devices_and_unknown_compressions_are_refused(tmp_path, change, reason):
    entry = ZipInfo("resources/x")
    for attribute, value in change.items():
        setattr(entry, attribute, value)
    message = refused(with_entry(tmp_path / "arm.fmu", entry, b"/etc/passwd"))
    assert message == f"is refused: its entry 'resources/x' {reason}"


def test_an_encrypted_entry_is_refused(tmp_path):
    path = with_entry(tmp_path / "arm.fmu", "resources/x", b"x")
    content = bytearray(path.read_bytes())
    content[content.rindex(b"PK\1\2") + 8] |= 1
    path.write_bytes(content)
    assert refused(path) == "is refused: its entry 'resources/x' is encrypted"


def test_a_repeated_entry_is_refused(tmp_path):
    with pytest.warns(UserWarning, match="Duplicate name"):
        path = with_entry(tmp_path / "arm.fmu", NAME, description(3).encode())
    assert refused(path) == "is refused: its entry 'modelDescription.xml' is there more than once"


def test_a_bad_checksum_is_refused(tmp_path):
    entry = ZipInfo("resources/x")
    entry.compress_type = ZIP_STORED
    path = with_entry(tmp_path / "arm.fmu", entry, b"sound content")
    path.write_bytes(path.read_bytes().replace(b"sound content", b"other content"))
    assert refused(path) == "is a damaged zip archive: 'resources/x' has a bad checksum"


def test_a_zip_bomb_is_refused(tmp_path):
    entry = ZipInfo("resources/x")
    entry.compress_type = ZIP_DEFLATED
    message = refused(with_entry(tmp_path / "arm.fmu", entry, bytes(entries.BOMB_BYTES)))
    assert re.fullmatch(
        r"is refused: its \d+ bytes unpack to \d+, more than 200 times as many", message
    )


def test_a_zip_bomb_that_understates_its_size_is_refused(tmp_path):
    entry = ZipInfo("resources/x")
    entry.compress_type = ZIP_DEFLATED
    path = with_entry(tmp_path / "arm.fmu", entry, bytes(100_000))
    sizes = (100_000).to_bytes(4, "little")
    path.write_bytes(path.read_bytes().replace(sizes, (10).to_bytes(4, "little")))
    assert refused(path).startswith("is a damaged zip archive: ")


def declaring(path: Path, size: int) -> Path:
    """Write an archive whose last entry declares a size."""
    path = with_entry(path, "resources/x", b"x")
    content = bytearray(path.read_bytes())
    at = content.rindex(b"PK\1\2") + 24
    content[at : at + 4] = size.to_bytes(4, "little")
    path.write_bytes(content)
    return path


def test_archives_beyond_any_limit_are_refused(tmp_path, monkeypatch):
    path = tmp_path / "arm.fmu"
    assert refused(declaring(path, 3 << 30)) == "is refused: it unpacks to 3.0 GiB, more than 1 GiB"
    monkeypatch.setattr(entries, "MOST_ENTRIES", 5)
    message = refused(with_entry(path, "resources/x"))
    assert re.fullmatch(r"is refused: it has \d+ entries, more than 5", message)
    with path.open("wb") as file:
        file.truncate((1 << 30) + 1)
    assert refused(path) == "is 1.0 GiB, more than 1 GiB"


# Anything else


def test_a_folder_is_refused_as_fmu(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"cannot be read: Is a directory$"):
        open_archive(tmp_path)
