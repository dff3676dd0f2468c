"""FMUs of FMI 1.0 (Model Exchange 1.0, section 3; Co-Simulation 1.0, section 4): read, not run."""

from zipfile import ZipFile

import fmpy
import pytest

from nrs_cosim.plant_fmu.archives.archive import open_archive, read_archive
from nrs_cosim.plant_fmu.archives.compilation import compiled
from nrs_cosim.plant_fmu.errors import FmuError
from tests.command import nrs

STEPPED = "<Implementation><CoSimulation_StandAlone><Capabilities/></CoSimulation_StandAlone>"
KINDS = {"ModelExchange": "", "CoSimulation": f"{STEPPED}</Implementation>"}
REFUSAL = "is of FMI 1.0, which is read but not run; have its tool export it as FMI 2.0 or 3.0"


def pendulum(path, kind):
    """Write a pendulum whose angle comes from its start, with one input and one parameter."""

    def variable(name, attributes, real):
        return f'<ScalarVariable name="{name}" {attributes}><Real {real}/></ScalarVariable>'

    variables = [
        variable("phi", 'valueReference="1" causality="output"', 'unit="rad" start="0.5"'),
        variable("der(phi)", 'valueReference="2"', 'unit="rad/s"'),
        variable("u", 'valueReference="3" causality="input" description="torque"', 'start="0"'),
        variable("m", 'valueReference="4" variability="parameter"', 'start="2" fixed="true"'),
    ]
    text = (
        '<fmiModelDescription fmiVersion="1.0" modelName="Pendulum" modelIdentifier="Pendulum" '
        'guid="{1}" numberOfContinuousStates="2" numberOfEventIndicators="0">'
        f"<ModelVariables>{''.join(variables)}</ModelVariables>{KINDS[kind]}</fmiModelDescription>"
    )
    with ZipFile(path, "w") as archive:
        archive.writestr("modelDescription.xml", text)
        archive.writestr("sources/Pendulum.c", "")
        for platform in ("win32", fmpy.platform):
            archive.writestr(f"binaries/{platform}/Pendulum{fmpy.sharedLibraryExtension}", b"")
    return path


@pytest.mark.parametrize("kind", KINDS)
def test_what_it_is_and_has_is_told_and_that_it_is_not_run(tmp_path, kind):
    path = pendulum(tmp_path / "p.fmu", kind)
    said = read_archive(path).describe()
    assert (said["name"], said["fmi_version"], said["kinds"]) == ("Pendulum", "1.0", [kind])
    assert said["platforms"] == sorted(["win32", fmpy.platform])
    assert said["cannot_run_here"] == REFUSAL
    assert [
        (v["name"], v["causality"], v["unit"], v["start"], v["description"])
        for v in said["variables"]
    ] == [
        ("phi", "output", "rad", "0.5", ""),
        ("der(phi)", "local", "rad/s", "", ""),
        ("u", "input", "", "0", "torque"),
        ("m", "parameter", "", "2", ""),
    ]
    for refused in (open_archive, lambda path: compiled(read_archive(path))):
        with pytest.raises(FmuError, match=REFUSAL):
            refused(path)


def test_info_shows_it_and_check_refuses_it(tmp_path):
    path = pendulum(tmp_path / "p.fmu", "CoSimulation")
    shown = nrs("fmu", "info", path)
    assert "1.0, CoSimulation" in shown.stdout
    assert "cannot run here: is of FMI 1.0" in " ".join(shown.stdout.split())
    checked = nrs("fmu", "check", path)
    assert (checked.returncode, checked.stdout) == (2, "")
    assert REFUSAL in checked.stderr
