"""Archives with any bytes, entries and descriptions are read, or refused with their cause."""

import random
import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from zipfile import ZipFile, ZipInfo

import fmpy
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from nrs_cosim.plant_fmu.archives.archive import open_archive, unpacked
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.errors import FmuError
from tests.cases import cases
from tests.plant_fmu.rewritten_fmus import NAME, description
from tests.plant_fmu.test_archive import with_entry

FUZZ = settings(
    derandomize=True,
    database=None,
    deadline=None,
    max_examples=cases(150, 60),
    phases=(Phase.generate,),
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)


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


@settings(FUZZ, max_examples=cases(300, 100))
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
