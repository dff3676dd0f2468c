"""An archive from a stranger is read, or refused with its cause; it never does anything else."""

import os
import random
import re
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from threading import Event
from zipfile import ZIP_BZIP2, ZIP_DEFLATED, ZIP_STORED, ZipFile, ZipInfo

import fmpy
import pytest
from fmpy.fmi3 import FMU3Slave
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from nrs_cosim.plant_fmu.archives import entries, model_description
from nrs_cosim.plant_fmu.archives.archive import find_archive, open_archive, unpacked
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi import library
from nrs_cosim.plant_fmu.fmi.library import Library
from tests.guard import GUARD, VAIN
from tests.plant_fmu.rewritten_fmus import NAME, description, rewritten

FUZZ = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=150,
    phases=(Phase.generate,),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder in which all temporary folders of a test lie."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


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

    monkeypatch.setitem(library._FMPY, (3, "CoSimulation"), begun)
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


def test_a_description_that_violates_the_schema_still_works(tmp_path):
    def invalid(text: str) -> str:
        text = text.replace("<ModelStructure>", "<ModelStructure><Strange/>")
        return text.replace(' modelName="two_link_arm"', ' unheardOf="1"')

    path = rewritten(tmp_path / "arm.fmu", 2, invalid)
    with pytest.raises(fmpy.model_description.ValidationError):
        fmpy.read_model_description(path)
    assert find_quantity(open_archive(path), "q").size == 2


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


def test_a_description_that_is_too_large_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(model_description, "MOST_BYTES", 1 << 10)
    assert refused(rewritten(tmp_path / "arm.fmu", 3, str)).startswith(
        "its modelDescription.xml is "
    )


@pytest.mark.parametrize(
    ("fmi", "edit", "message"),
    [
        (2, lambda text: text.replace("</fmiModel", "<fmiModel"), r"line \d+, column \d+"),
        (2, lambda text: text.replace("<ModelVariables>", "<Model Variables"), r"line \d+"),
        (2, lambda _: "", "Document is empty, line 1"),
        (
            2,
            lambda text: text.replace('fmiVersion="2.0"', 'fmiVersion="1.0"'),
            "is of FMI 1.0; FMI",
        ),
        (2, lambda text: text.replace('fmiVersion="2.0"', ""), "is of FMI without version"),
        (2, lambda text: text.replace("fmiModelDescription", "html"), "is a html, expected fmiMod"),
        (
            2,
            lambda text: text.replace("<Real", "<Float64"),
            r"line \d+: variable 'time' has no type",
        ),
        (3, lambda text: text.replace("Float64", "Real"), r"line \d+: variable 'time' has no type"),
        (
            3,
            lambda text: text.replace('valueReference="1"', 'valueReference="-1"'),
            r"variable 'tau' has the value reference '-1'",
        ),
        (
            3,
            lambda text: text.replace('valueReference="1"', 'valueReference="4294967296"'),
            r"variable 'tau' has the value reference '4294967296'",
        ),
        (
            2,
            lambda text: text.replace('causality="input"', 'causality="inptu"', 1),
            r"\(line \d+, column 0\): .*'inptu'",
        ),
        (
            2,
            lambda text: text.replace('causality="input"', 'causality="parameter"', 1),
            r'Variable ".*" \(line \d+\) has an illegal combination',
        ),
        (
            3,
            lambda text: text.replace('<Output valueReference="', '<Output valueReference="80', 1),
            r"line \d+: valueReference of Output names the value reference 80\d+, but there",
        ),
        (
            3,
            lambda text: text.replace(' derivative="', ' derivative="9', 1),
            r"line \d+: derivative of Float64 names the value reference 9\d+, but there is none",
        ),
        (
            2,
            lambda text: text.replace('<Unknown index="', '<Unknown index="80', 1),
            r"line \d+: index of Unknown names variable no. 80\d+, but there is none",
        ),
        (
            2,
            lambda text: re.sub("<ModelVariables>.*</ModelVariables>", "", text, flags=re.DOTALL),
            "ModelVariables",
        ),
    ],
)
def test_an_unusable_description_is_refused_with_the_line(tmp_path, fmi, edit, message):
    result = refused(rewritten(tmp_path / "arm.fmu", fmi, edit))
    assert re.match(
        f"its modelDescription.xml (cannot be used|is not valid XML): .*{message}", result
    )


def test_entities_are_not_expanded_and_nothing_is_fetched(tmp_path):
    secret = tmp_path / "secret"
    secret.write_text("secret")
    for entity in (f'SYSTEM "{secret.as_uri()}"', '"&a;&a;"', '"two"'):
        doctype = f'<!DOCTYPE x [<!ENTITY a "{"a" * 100}"><!ENTITY b {entity}>]>'

        def expanding(text: str, doctype: str = doctype) -> str:
            text = text.replace("<fmiModel", f"{doctype}<fmiModel", 1)
            return text.replace('modelName="', 'modelName="&b;', 1)

        result = refused(rewritten(tmp_path / "arm.fmu", 3, expanding))
        assert "secret" not in result
        assert result.startswith("its modelDescription.xml ")


EACH_PLATFORM = pytest.mark.parametrize(
    ("fmi", "here"), [(2, fmpy.platform), (3, fmpy.platform_tuple)]
)
LIBRARY = f"two_link_arm{fmpy.sharedLibraryExtension}"


def moved(path: Path, fmi: int, to: str, *others: str, sources: bool = False) -> Path:
    """Write the two-link arm's archive with its library elsewhere, and with empty entries more."""
    with ZipFile(build("two_link_arm", fmi)) as source, ZipFile(path, "w") as target:
        for name in source.namelist():
            if sources or not name.startswith("sources/"):
                target.writestr(to if name.startswith("binaries/") else name, source.read(name))
        for name in others:
            target.writestr(name, b"")
    return path


@EACH_PLATFORM
def test_an_fmu_for_another_platform_is_refused(tmp_path, fmi, here):
    path = moved(tmp_path / "arm.fmu", fmi, "binaries/win32/two_link_arm.dll")
    lacking = f"has no library binaries/{here}/{LIBRARY} for this platform; it has"
    assert refused(path) == f"{lacking} libraries for win32"


@EACH_PLATFORM
def test_a_platform_folder_without_a_library_does_not_count(tmp_path, fmi, here):
    path = tmp_path / "arm.fmu"
    moved(
        path, fmi, f"binaries/win32/VisualStudio17/{LIBRARY}", "binaries/win64/", "binaries/a.txt"
    )
    lacking = f"has no library binaries/{here}/{LIBRARY} for this platform; it has"
    assert refused(path) == f"{lacking} no library at all"


@EACH_PLATFORM
def test_sources_without_a_binary_suggest_to_compile_them(tmp_path, fmi, here):
    path = moved(tmp_path / "arm.fmu", fmi, "binaries/readme", sources=True)
    lacking = f"has no library binaries/{here}/{LIBRARY} for this platform; it has"
    assert refused(path) == (
        f"{lacking} no library at all, but sources: `fmpy compile` may build one from them (it "
        f"needs CMake)"
    )


@EACH_PLATFORM
def test_a_library_of_another_name_is_named(tmp_path, fmi, here):
    other = f"binaries/{here}/arm{fmpy.sharedLibraryExtension}"
    path = moved(tmp_path / "arm.fmu", fmi, other, sources=True)
    assert refused(path) == (
        f"has no library binaries/{here}/{LIBRARY} for this platform; it has {other}, which is not "
        f"named as its modelIdentifier"
    )


def test_an_fmu_only_for_scheduled_execution_is_refused(tmp_path):
    def scheduled(text: str) -> str:
        text = re.sub(r"<CoSimulation[^>]*/>", "", text)
        return text.replace("<ModelExchange", "<ScheduledExecution")

    assert refused(rewritten(tmp_path / "arm.fmu", 3, scheduled)) == (
        "offers neither CoSimulation nor ModelExchange, but ScheduledExecution alone"
    )


@EACH_PLATFORM
def test_a_library_that_cannot_be_loaded_names_no_temporary_file(tmp_path, fmi, here):
    path = moved(tmp_path / "arm.fmu", fmi, "binaries/readme", f"binaries/{here}/{LIBRARY}")
    archive = open_archive(path, "arm.fmu")
    with unpacked(archive) as folder, pytest.raises(FmuError) as error:
        Library(archive, folder, "CoSimulation")
    result = str(error.value)
    assert result.startswith("arm.fmu: its library cannot be loaded: ")
    assert f"binaries/{here}/{LIBRARY}" in result
    assert str(folder) not in result


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_that_needs_its_tool_fails_with_that_hint(tmp_path, fmi):
    def needing(text: str) -> str:
        text = re.sub('generationTool="[^"]*"', 'generationTool="Arms 7"', text)
        return text.replace('needsExecutionTool="false"', 'needsExecutionTool="true"')

    path = rewritten(tmp_path / "arm.fmu", fmi, needing)
    archive = open_archive(path, "arm.fmu")
    assert archive.describe()["needs_execution_tool"] == "Arms 7"
    loads = [found.text for found in check(CheckTask(archive)).findings if found.topic == "loads"]
    assert len(loads) == 2
    assert all("; it needs Arms 7 on this machine (needsExecutionTool)" in text for text in loads)
    archive.description.guid = archive.description.instantiationToken = "another"
    with unpacked(archive) as folder, Library(archive, folder, "CoSimulation") as loaded:
        with pytest.raises(FmuError) as error:
            loaded.instantiate("robot 1")
        assert str(error.value).startswith("arm.fmu: cannot be instantiated")
        assert str(error.value).endswith("; it needs Arms 7 on this machine (needsExecutionTool)")


def test_a_library_outside_the_archive_is_refused(tmp_path):
    def outside(text: str) -> str:
        return text.replace('modelIdentifier="', 'modelIdentifier="../../../')

    assert "has no library" in refused(rewritten(tmp_path / "arm.fmu", 3, outside))


def test_an_fmu_without_an_interface_is_refused(tmp_path):
    def none(text: str) -> str:
        return re.sub(r"<(ModelExchange|CoSimulation)[^>]*/>", "", text)

    path = rewritten(tmp_path / "arm.fmu", 3, none)
    assert refused(path) == "offers neither CoSimulation nor ModelExchange"


# Anything else


def outcome(path: Path, temporary: Path) -> str:
    """Open, look for quantities and unpack; return how it ended, having left nothing behind."""
    before = sorted(p for p in path.parent.rglob("*") if p != path)
    try:
        archive = open_archive(path, "arm.fmu")
        with suppress(FmuError), unpacked(archive) as folder:
            assert all(p.resolve().is_relative_to(folder) for p in folder.rglob("*"))
        for name in ("q", "qd", "tau", "kp", "position_ref"):
            with suppress(FmuError):
                find_quantity(archive, name)
    except FmuError:
        return "refused"
    finally:
        assert not list(temporary.iterdir())
        assert sorted(p for p in path.parent.rglob("*") if p != path) == before
    return "read"


@FUZZ
@given(data=st.data(), fmi=st.sampled_from([2, 3]))
def test_damaged_bytes_give_an_archive_or_an_error(tmp_path, temporary, data, fmi):
    content = bytearray(build("two_link_arm", fmi).read_bytes())
    directory = content.index(b"PK\1\2")
    for _ in range(data.draw(st.integers(1, 4))):
        first = data.draw(st.sampled_from([0, directory, len(content) - 22]))
        at = data.draw(st.integers(first, len(content) - 1))
        content[at] ^= data.draw(st.integers(1, 255))
    if data.draw(st.booleans()):
        del content[data.draw(st.integers(0, len(content))) :]
    path = tmp_path / "arm.fmu"
    path.write_bytes(content)
    outcome(path, temporary)


@FUZZ
@given(
    name=st.text(st.sampled_from("./\\:~a\0é$ \n"), min_size=1, max_size=12)
    | st.sampled_from([NAME, f"{NAME}/x", "sources", "binaries/x" * 40, "sources/core.c/x", "./x"]),
    mode=st.sampled_from([0, 0o100644, 0o120777, 0o040755, 0o010644]),
    content=st.binary(max_size=20),
)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_any_entry_gives_an_archive_or_an_error(tmp_path, temporary, name, mode, content):
    entry = ZipInfo("placeholder")
    entry.filename, entry.external_attr = name, mode << 16
    outcome(with_entry(tmp_path / "arm.fmu", entry, content), temporary)


VALUES = (
    *("", "0", "-1", "1e999", "nan", "9" * 5000, "1" * 18, "4294967295", "true", "2 3"),
    *("q", "é", "&#x110000;", "a" * 100_000, "../../x", "{i}", "q[1]", "constant", "deg"),
)
DIMENSIONS = (
    *('start="0"', 'start="-2"', f'start="{"9" * 30}"', 'start="x"', ""),
    *('valueReference="1"', 'valueReference="999"', 'start="2" valueReference="1"'),
)


def deleted_attribute(text: str, chance: random.Random) -> str:
    found = list(re.finditer(r' \w+="[^"]*"', text))
    match = chance.choice(found)
    return text[: match.start()] + text[match.end() :]


def changed_attribute(text: str, chance: random.Random) -> str:
    match = chance.choice(list(re.finditer(r'="([^"]*)"', text)))
    value = chance.choice(VALUES)
    return text[: match.start(1)] + value + text[match.end(1) :]


def changed_type(text: str, chance: random.Random) -> str:
    old = chance.choice(["Real", "Float64", "ScalarVariable", "ModelVariables", "BaseUnit", "Unit"])
    new = chance.choice(["Real", "Float32", "String", "Enumeration", "Binary", "Clock", "x", "!--"])
    return text.replace(f"<{old}", f"<{new}", chance.choice([1, 5, -1]))


def doubled_element(text: str, chance: random.Random) -> str:
    match = chance.choice(list(re.finditer(r"<(\w+)[^>]*/>", text)))
    return text[: match.end()] + match[0] * chance.choice([1, 2, 200]) + text[match.end() :]


def changed_dimension(text: str, chance: random.Random) -> str:
    new = chance.choice(DIMENSIONS)
    return re.sub(r'<Dimension start="\d"', f"<Dimension {new}", text, count=chance.choice([0, 1]))


def changed_characters(text: str, chance: random.Random) -> str:
    at = chance.randrange(len(text))
    return text[:at] + chance.choice(["<", ">", "&", '"', "\0", "</x>", "<x>" * 300]) + text[at:]


EDITS: list[Callable[[str, random.Random], str]] = [
    deleted_attribute,
    changed_attribute,
    changed_type,
    doubled_element,
    changed_dimension,
    changed_characters,
]


@settings(FUZZ, max_examples=300)
@given(
    fmi=st.sampled_from([2, 3]),
    edits=st.lists(st.sampled_from(EDITS), min_size=1, max_size=3),
    seed=st.integers(0, 1 << 32),
    encoding=st.sampled_from(["utf-8"] * 8 + ["utf-16", "latin-1", "utf-7"]),
)
def test_any_description_is_read_or_refused(tmp_path, temporary, fmi, edits, seed, encoding):
    chance = random.Random(seed)
    text = description(fmi)
    for edit in edits:
        text = edit(text, chance)
    path = tmp_path / "arm.fmu"
    folder = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    with ZipFile(path, "w") as archive:
        archive.writestr(NAME, text.encode(encoding, "replace"))
        archive.writestr(f"binaries/{folder}/two_link_arm{fmpy.sharedLibraryExtension}", b"")
    outcome(path, temporary)


def test_a_folder_is_refused_as_fmu(tmp_path: Path) -> None:
    with pytest.raises(FmuError, match=r"cannot be read: Is a directory$"):
        open_archive(tmp_path)
