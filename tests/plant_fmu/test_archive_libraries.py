"""The library in an archive: for this platform, of its model's name, and one that loads."""

import re

import fmpy
import pytest

from nrs_cosim.plant_fmu.archives.archive import open_archive, unpacked
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.library import Library
from tests.plant_fmu.rewritten_fmus import moved, rewritten
from tests.plant_fmu.test_archive import refused

EACH_PLATFORM = pytest.mark.parametrize(
    ("fmi", "here"), [(2, fmpy.platform), (3, fmpy.platform_tuple)]
)


LIBRARY = f"two_link_arm{fmpy.sharedLibraryExtension}"


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
        f"{lacking} no library at all, but C sources: --compile, or `nrs fmu compile`, makes one "
        f"of them"
    )


@EACH_PLATFORM
@pytest.mark.parametrize(
    ("name", "beside"),
    [("arm", ()), ("Two_Link_Arm", ("helper",))],
    ids=["the only one", "in other letters"],
)
def test_a_library_of_another_name_is_taken_and_told_of(tmp_path, fmi, here, name, beside):
    places = [f"binaries/{here}/{one}{fmpy.sharedLibraryExtension}" for one in (name, *beside)]
    path = moved(tmp_path / "arm.fmu", fmi, *places)
    checked = check(CheckTask(open_archive(path)))
    assert checked.passes
    loads = [finding.text for finding in checked.findings if finding.topic == "loads"]
    assert len(loads) == 2
    assert all(f"; {places[0]} is not named as its modelIdentifier" in text for text in loads)


@EACH_PLATFORM
def test_one_of_several_libraries_of_other_names_is_not_guessed(tmp_path, fmi, here):
    others = [f"binaries/{here}/{name}{fmpy.sharedLibraryExtension}" for name in "ab"]
    assert refused(moved(tmp_path / "arm.fmu", fmi, *others)) == (
        f"has no library binaries/{here}/{LIBRARY} for this platform; it has {', '.join(others)}, "
        f"none named as its modelIdentifier"
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
