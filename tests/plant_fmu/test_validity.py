"""Structured names are judged as FMPy's grammar has them, at a cost linear in their length."""

from types import SimpleNamespace

import pytest
from fmpy.validation import _validate_variable_names

from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.checking.validity import is_structured, validity
from tests.plant_fmu.rewritten_fmus import rewritten

GOOD = (
    "q q1 _q Arm.q arm[1].q[2,3] der(q) der(arm.q[1]) der(arm[2].q,2) 'a b'.q 'x+y'[1] der "
    "a.b.c.d e[10,11,12].f '[]'"
)
BAD = (
    "1q q[ q[] q[a] q[1 q..a .q q. der(q der(der(q)) q[1]q q[1][2] '' 'a q-1 q(1) der(q,) q[1,] "
    "größe q[-1] der(q,a)"
)


def by_fmpy(name):
    """Whether FMPy's own grammar takes a name."""
    variable = SimpleNamespace(name=name, sourceline=1)
    result = SimpleNamespace(variableNamingConvention="structured", modelVariables=[variable])
    return not _validate_variable_names(result)


@pytest.mark.parametrize("name", [*GOOD.replace("a b", "a_b").split(), "'a b'.q"])
def test_structured_names_are_accepted_as_by_the_grammar(name):
    assert by_fmpy(name)
    assert is_structured(name)


@pytest.mark.parametrize("name", [*BAD.split(), "", "a b", "q\n", "q [1]"])
def test_other_names_are_refused_as_by_the_grammar(name):
    assert not by_fmpy(name)
    assert not is_structured(name)


def validated(path):
    return [(f.status, f.text) for f in validity(open_archive(path), 60.0)]


def test_many_variables_and_long_names_are_never_parsed_by_the_general_parser(
    tmp_path, monkeypatch
):
    def parse(*_, **__):
        raise AssertionError("the general parser is called")

    monkeypatch.setattr("lark.Lark", parse)
    with pytest.raises(AssertionError, match="general parser"):
        by_fmpy("q")
    names = [f"body[{i}].x" for i in range(500)] + [f"{'x' * 6000}{i}" for i in range(20)]
    more = "".join(
        f'<Float64 name="{name}" valueReference="{10_000 + i}" causality="local"/>'
        for i, name in enumerate(names)
    )
    end = "</ModelVariables>"
    path = rewritten(tmp_path / "a.fmu", 3, lambda text: text.replace(end, more + end))
    assert validated(path) == [("holds", "it is as FMI 3.0 has it")]


def test_names_that_are_not_structured_are_reported(tmp_path):
    more = '<Float64 name="a b" valueReference="10000" causality="local"/></ModelVariables>'
    path = rewritten(tmp_path / "a.fmu", 3, lambda text: text.replace("</ModelVariables>", more))
    ((status, text),) = validated(path)
    assert status == "note"
    assert text.startswith('Variable "a b" (line ')
    assert text.endswith("is not of the structured naming convention.")
