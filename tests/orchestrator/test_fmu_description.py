"""What `nrs fmu info` says: all of an FMU, wherever it runs, in columns that stay apart."""

import json
import re
from zipfile import ZipFile

import pytest

from nrs_cosim.plant_fmu.bundled.builder import build
from tests.command import nrs
from tests.plant_fmu.rewritten_fmus import rewritten, with_variables

LONG = "stepSizeCtrlSafetyFactorOfTheSolverThatIsInside"
TYPES = '<SimpleType name="Angle"><Real unit="rad"/></SimpleType>'
VARIABLES = f"""
<ScalarVariable name="phi" valueReference="1" causality="output">
  <Real declaredType="Angle" start="0.5"/></ScalarVariable>
<ScalarVariable name="{LONG}" valueReference="2" causality="parameter" variability="fixed">
  <Real unit="s" start="0.9"/></ScalarVariable>
<ScalarVariable name="x[1]" valueReference="3" causality="local"><Real start="1"/></ScalarVariable>
<ScalarVariable name="x[2]" valueReference="4" causality="local"><Real start="2"/></ScalarVariable>
<ScalarVariable name="y[1]" valueReference="5" causality="local"><Real start="7"/></ScalarVariable>
<ScalarVariable name="y[2]" valueReference="6" causality="local"><Real start="7"/></ScalarVariable>
<ScalarVariable name="file" valueReference="1" causality="parameter" variability="fixed">
  <String start="a b"/></ScalarVariable>
"""


def shown(path):
    done = nrs("fmu", "info", path)
    assert (done.returncode, done.stderr) == (0, "")
    return done.stdout


def cells(text):
    """Return each line of the table, cut where two blanks or more are."""
    table = text.split("\n\n")[1]
    return [re.split(r"  +", line.strip()) for line in table.splitlines()]


def test_units_and_starts_are_shown_and_long_names_stay_apart(tmp_path):
    path = with_variables(tmp_path / "a.fmu", 2, VARIABLES, types=TYPES)
    assert cells(shown(path))[1:] == [
        ["phi", "output", "1", "rad", "0.5"],
        [LONG, "parameter", "1", "s", "0.9"],
        ["x", "local", "2", "1 2"],
        ["y", "local", "2", "7"],
        ["file", "parameter", "1", "'a b'"],
    ]
    result = json.loads(nrs("fmu", "info", path, "--json").stdout)
    assert result["variables"][0]["unit"] == "rad"


def test_a_bundled_models_start_values_and_structural_parameter_are_shown():
    text = shown("n_link_arm")
    rows = {row[0]: row for row in cells(text)}
    assert rows["n"][1:4] == ["structural", "1", "3"]
    assert rows["g"][1:5] == ["parameter", "1", "m/s2", "9.8"]
    assert rows["m"][1:5] == ["parameter", "3", "kg", "1.0"]
    assert "A structural parameter decides how many numbers others hold" in text
    assert "structural" not in shown("two_link_arm")


@pytest.mark.parametrize("fmi", [2, 3])
def test_an_fmu_for_another_machine_is_described_as_any_other(tmp_path, fmi):
    with ZipFile(build("two_link_arm", fmi)) as source, ZipFile(tmp_path / "a.fmu", "w") as target:
        for name in source.namelist():
            elsewhere = re.sub("binaries/[^/]*/(.*)[.].*", r"binaries/win32/\1.dll", name)
            target.writestr(elsewhere, source.read(name))
    text = shown(tmp_path / "a.fmu")
    here, other = (part.split("\n\n")[1] for part in (shown(build("two_link_arm", fmi)), text))
    assert other == here
    assert "cannot run here: has no library binaries/" in text
    assert "it has libraries for win32" in text
    result = json.loads(nrs("fmu", "info", tmp_path / "a.fmu", "--json").stdout)
    assert "libraries for win32" in result["cannot_run_here"]
    assert nrs("fmu", "check", tmp_path / "a.fmu").returncode == 2


def test_an_fmu_with_an_unsupported_interface_is_described(tmp_path):
    def scheduled(text):
        text = re.sub(r"<CoSimulation[^>]*/>", "", text)
        return text.replace("<ModelExchange", "<ScheduledExecution")

    text = shown(rewritten(tmp_path / "a.fmu", 3, scheduled))
    assert "cannot run here: offers neither CoSimulation nor ModelExchange, but" in text
    assert "position_ref" in text


def test_the_tool_that_an_fmu_needs_is_shown(tmp_path):
    def needing(text):
        return text.replace('needsExecutionTool="false"', 'needsExecutionTool="true"')

    assert "needs      nrs-cosim, on the machine" in shown(
        rewritten(tmp_path / "a.fmu", 2, needing)
    )
