"""A plant's parameters in a file of SSP are those of a table, and a recording has them."""

import re

import numpy as np
import pytest

from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.export.package import _parameter_set
from nrs_cosim.orchestrator.scenario.file import read_scenario
from tests.command import nrs
from tests.scenarios import SHORT, write

VALUES = "http://ssp-standard.org/SSP1/SystemStructureParameterValues"


def ssv(*parameters, root="ParameterSet"):
    """Return the text of a set of parameters, each a name and what is inside."""
    inside = "".join(
        f'<ssv:Parameter name="{name}">{value}</ssv:Parameter>' for name, value in parameters
    )
    return (
        f'<ssv:{root} xmlns:ssv="{VALUES}" version="1.0" name="a"><ssv:Parameters>{inside}'
        f"</ssv:Parameters></ssv:{root}>"
    )


def value(kind, text, more=""):
    return f'<ssv:{kind} value="{text}"{more}/>'


def resolved(folder, text, changes=None):
    (folder / "arm.ssv").write_text(text, "utf-8")
    write(folder / "s.toml", {"plant.parameters": "arm.ssv", **SHORT}, changes or {})
    return read_scenario(folder / "s.toml").scenario


def test_values_have_their_types_and_arrays_are_whole(tmp_path):
    matrix = [(f"I[{i},{j}]", value("Real", f"{i}.{j}")) for j in (1, 2) for i in (1, 2)]
    found = resolved(
        tmp_path,
        ssv(
            ("m1", value("Real", "0.1")),
            ("gear", value("Integer", "3")),
            ("brake", value("Boolean", "true")),
            ("mode", value("Enumeration", "free")),
            ("file", value("String", " a,b ")),
            ("c[2]", value("Real", "2.5")),
            ("c[1]", value("Real", "1.5")),
            *matrix,
            ("r[1]", value("Real", "1")),
            ("r[3]", value("Real", "3")),
        ),
    ).plant.parameters
    assert found == {
        "m1": 0.1,
        "gear": 3,
        "brake": True,
        "mode": "free",
        "file": " a,b ",
        "c": (1.5, 2.5),
        "I": ((1.1, 1.2), (2.1, 2.2)),
        "r[1]": 1.0,
        "r[3]": 3.0,
    }
    assert {type(found[name]) for name in ("gear", "brake", "m1")} == {int, bool, float}


def test_numbers_that_we_write_are_read_to_the_last_bit(tmp_path):
    numbers = np.random.Generator(np.random.Philox(5)).normal(size=40) * 10.0 ** np.arange(-20, 20)
    written = {f"x_{i}": float(number) for i, number in enumerate(numbers)}
    assert resolved(tmp_path, _parameter_set(written).decode()).plant.parameters == written


WRONG = {
    "not XML": ("arm.ssv: not valid XML", "<a"),
    "another root": ("expected a ParameterSet of SSP 1.0", ssv(root="ParameterMapping")),
    "no number": ("'m1': expected a value of Real, got '1,5'", ssv(("m1", value("Real", "1,5")))),
    "not finite": ("'m1': expected a value of Real", ssv(("m1", value("Real", "inf")))),
    "no truth": ("'b': expected a value of Boolean", ssv(("b", value("Boolean", "yes")))),
    "unknown type": ("'b': expected a value of Real, Integer", ssv(("b", value("Binary", "00")))),
    "no value": ("'b': expected a value of Real, Integer", ssv(("b", "<ssv:Real/>"))),
    "a name twice": ("'a': expected a name, once", ssv(*[("a", value("Real", "1"))] * 2)),
    "a unit": (
        "'a': is in 'mm'; give it in the unit of the FMU's variable",
        ssv(("a", value("Real", "1", ' unit="mm"'))),
    ),
    "a gain": ("plant.parameters.kp: give it as controller.kp", ssv(("kp", value("Real", "1")))),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_wrong_of_a_file_is_told_with_its_place(tmp_path, case):
    why, text = WRONG[case]
    with pytest.raises(ScenarioError, match=re.escape(why)) as error:
        resolved(tmp_path, text)
    assert "plant.parameters" in str(error.value)


@pytest.mark.parametrize(("given", "why"), [(3, "a table"), ("arm.txt", "path of an .ssv file")])
def test_what_is_neither_a_table_nor_such_a_file_is_refused(tmp_path, given, why):
    write(tmp_path / "s.toml", {"plant.parameters": given})
    with pytest.raises(ScenarioError, match=rf"plant\.parameters: expected .*{why}"):
        read_scenario(tmp_path / "s.toml")


def test_a_missing_file_is_named(tmp_path):
    write(tmp_path / "s.toml", {"plant.parameters": "none.ssv"})
    with pytest.raises(ScenarioError, match=r"plant\.parameters: none\.ssv: no such file"):
        read_scenario(tmp_path / "s.toml")


def test_a_run_is_that_of_the_table_and_its_recording_needs_no_file(tmp_path):
    heavy = ssv(("m1", value("Real", "2.5")), ("J2", value("Real", "4")))
    (tmp_path / "own.ssv").write_text(ssv(("m1", value("Real", "0.7"))), "utf-8")
    own = {"robots": [{"id": 2, "plant": {"parameters": "own.ssv"}}]}
    resolved(tmp_path, heavy, own)
    table = {"plant.parameters": {"m1": 2.5, "J2": 4.0}}
    own = {"robots": [{"id": 2, "plant": {"parameters": {"m1": 0.7}}}]}
    write(tmp_path / "t.toml", table, own, SHORT)
    for name, workers in (("s", "2"), ("t", "1")):
        command = ["run", f"{name}.toml", "-o", f"{name}.mcap", "--workers", workers]
        assert nrs(*command, cwd=tmp_path).returncode == 0
    for file in tmp_path.glob("*.ssv"):
        file.unlink()
    compared = nrs("diff", "s.mcap", "t.mcap", cwd=tmp_path).stdout
    assert "the same samples and states, to the last bit" in compared
    assert nrs("replay", "s.mcap", "--verify", cwd=tmp_path).returncode == 0


def test_a_change_of_one_parameter_of_a_file_is_refused(tmp_path):
    resolved(tmp_path, ssv(("m1", value("Real", "1"))))
    done = nrs("check", "s.toml", "--set", "plant.parameters.m1=2", cwd=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "parameters.m1: parameters are those of 'arm.ssv'" in done.stderr
