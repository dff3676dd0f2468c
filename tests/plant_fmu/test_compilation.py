"""FMUs without a library for this machine are compiled where that is asked for; and for others."""

import re
import shutil
from contextlib import ExitStack
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import open_archive, read_archive
from nrs_cosim.plant_fmu.archives.compilation import compiled
from nrs_cosim.plant_fmu.bundled.builder import build, write
from nrs_cosim.plant_fmu.bundled.compiler import PLATFORMS, ZIG, compiler, has_zig
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.cases import cases
from tests.command import nrs
from tests.plant_fmu import talker
from tests.plant_fmu.rewritten_fmus import moved, sources_alone
from tests.scenarios import write as write_scenario

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")


def resting(*q: float) -> Body:
    """Return a robot at rest at q, with gains of 1."""
    none, one = np.zeros(len(q)), np.eye(len(q))
    still = Disturbance(none, none, *np.zeros((3, len(q), 0)))
    return Body(1, {}, one, one, still, np.array(q), none, none, none)


ZIG_OR_SKIP = pytest.mark.skipif(not has_zig(), reason="needs ziglang (the extra `compiler`)")


Edit = tuple[str, str]


def talking_sources(path: Path, fmi: int, *, listed: bool, edit: Edit = ("", "")) -> Path:
    """Write an FMU of the talker's sources, which are as its description lists them, or not."""
    text = talker.FMI2 if fmi == 2 else talker.FMI3
    definitions = {"FMI": str(fmi), "START": "0.5", "PRINTS": "0"}
    definitions |= {"ENVIRONMENT": talker.ENVIRONMENT, "NAME": talker.NAME}
    defines = "".join(f"#define {name} {value}\n" for name, value in definitions.items())
    with ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        stubs = talker._stubs(fmi)
        archive.writestr("sources/calls/stubs.c" if listed else "sources/stubs.c", stubs)
        archive.writestr("sources/inside/defined.h", "" if listed else defines)
        source = talker.SOURCE.read_text()
        if not listed:
            archive.writestr("sources/talker.c", '#include "inside/defined.h"\n' + source)
            return path
        archive.writestr("sources/talker.c", '#include "defined.h"\n' + source)
        defined = "".join(
            f'<PreprocessorDefinition name="{name}" value="{value.replace(">", "&gt;")}"/>'
            for name, value in definitions.items()
        )
        build_description = (
            '<fmiBuildDescription fmiVersion="3.0"><BuildConfiguration modelIdentifier="talker">'
            f'<SourceFileSet language="C99"><SourceFile name="talker.c"/>'
            f'<SourceFile name="calls/stubs.c"/>{defined}<IncludeDirectory name="inside"/>'
            "</SourceFileSet></BuildConfiguration></fmiBuildDescription>"
        ).replace(*edit)
        archive.writestr("sources/buildDescription.xml", build_description)
    return path


@pytest.mark.parametrize("fmi", [2, 3])
def test_sources_become_the_plant_that_they_are(tmp_path, fmi):
    """The bundled arm's own sources move to the same bits as it does."""
    ended = []
    stranger = read_archive(sources_alone(tmp_path / "arm.fmu", fmi))
    assert stranger.obstacle
    for archive in (open_archive(build("two_link_arm", fmi)), compiled(stranger)):
        with ExitStack() as stack:
            plants = open_plants(stack, archive, [resting(0.0, 0.0)], {})
            plants.advance(0.0, 1.0)
            ended.append(plants.q.copy())
    assert not archive.ours
    assert archive.label == stranger.label
    assert np.array_equal(*ended)
    assert compiled(stranger).sha256 == archive.sha256


@pytest.mark.parametrize(("fmi", "listed"), [(2, False), (3, False), (3, True)])
def test_other_sources_compile_as_their_description_has_it(tmp_path, fmi, listed):
    path = talking_sources(tmp_path / "talker.fmu", fmi, listed=listed)
    archive = compiled(read_archive(path))
    with ExitStack() as stack:
        plants = open_plants(stack, archive, [resting(0.5)], {})
        assert plants.q.tolist() == [[0.5]]


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (("talker.c", "none.c"), "its description names sources/none.c, which it lacks"),
        (("calls/stubs.c", "inside/defined.h"), "sources/inside/defined.h: is no C"),
        (('name="inside"', 'name="../.."'), "includes ../.., which is not among its sources"),
        (('value="0.5"', 'value="("'), "cc failed:\n"),
        (("<fmiBuild", "<!DOCTYPE a><fmiBuild"), "cannot be read: it has a DOCTYPE"),
    ],
)
def test_what_cannot_be_compiled_is_refused_with_the_reason(tmp_path, edit, why):
    path = talking_sources(tmp_path / "talker.fmu", 3, listed=True, edit=edit)
    with pytest.raises(FmuError, match=re.escape(why)):
        compiled(read_archive(path))


def test_an_fmu_with_neither_library_nor_sources_has_nothing_to_compile(tmp_path):
    path = moved(tmp_path / "arm.fmu", 3, "binaries/readme")
    with pytest.raises(FmuError, match="there is nothing to compile"):
        compiled(read_archive(path))


def test_sources_run_only_where_they_are_asked_to_be_compiled(tmp_path):
    sources_alone(tmp_path / "arm.fmu", 3)
    write_scenario(tmp_path / "s.toml", {"run.duration": 0.2, "plant.fmu": "arm.fmu"})
    run = ["run", "s.toml", "-o", "run.mcap"]
    assert nrs(*run, cwd=tmp_path).returncode == 2
    for command in ([*run, "--workers", "2"], ["replay", "run.mcap", "--verify"]):
        done = nrs(*command, "--compile", cwd=tmp_path)
        assert done.returncode == 0, done.stderr


def test_zig_stands_in_only_where_there_is_no_compiler(monkeypatch, tmp_path):
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr("nrs_cosim.plant_fmu.bundled.compiler.has_zig", lambda: True)
    assert compiler() == ["cc"]
    monkeypatch.setenv("PATH", str(tmp_path))
    assert compiler() == list(ZIG)
    monkeypatch.setattr("nrs_cosim.plant_fmu.bundled.compiler.has_zig", lambda: False)
    with pytest.raises(FmuError, match="pip install 'nrs-cosim\\[compiler\\]'"):
        compiler()
    with pytest.raises(FmuError, match="compiling for chosen platforms needs zig"):
        build("planar_robot", 3, ["linux64"])


def test_platforms_of_fmi_3_alone_are_refused_for_fmi_2():
    with pytest.raises(FmuError, match="aarch64-linux: is no platform of FMI 2; take FMI 3"):
        build("planar_robot", 2, ["aarch64-linux"])


@ZIG_OR_SKIP
def test_an_fmu_for_other_platforms_is_the_same_bytes_on_a_rebuild(tmp_path, monkeypatch):
    platforms, built = cases(sorted(PLATFORMS), ["darwin64", "linux64"]), []
    for turn in ("first", "second"):
        monkeypatch.setenv("NRS_CACHE", str(tmp_path / turn))
        write("planar_robot", 3, tmp_path / f"{turn}.fmu", platforms)
        built.append((tmp_path / f"{turn}.fmu").read_bytes())
    assert built[0] == built[1]
    with ZipFile(tmp_path / "first.fmu") as archive:
        names = [name for name in archive.namelist() if name.startswith("binaries/")]
    places = [(PLATFORMS[name].fmi3, PLATFORMS[name].suffix) for name in platforms]
    assert names == sorted(f"binaries/{folder}/planar_robot{end}" for folder, end in places)
