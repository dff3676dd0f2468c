"""A start that cannot be set: a continuous state is set later, else parameters are named."""

import re
import shutil
import tomllib
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.archives.proposals import as_line, proposals
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.plant_fmu import hinge
from tests.plant_fmu.rewritten_fmus import with_variables
from tests.plant_fmu.talker import build_talker

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

REAL = (
    '<ScalarVariable name="{}" valueReference="{}" causality="parameter" variability="fixed">'
    '<Real start="{}"{}/></ScalarVariable>'
)
FLOAT = (
    '<Float64 name="{}" valueReference="{}" causality="parameter" variability="fixed" '
    'start="{}"{}/>'
)


def talker(
    path: Path, fmi: int, *parameters: tuple[Any, ...], depends: str = "", q: str = ""
) -> Archive:
    """Build an FMU whose q starts at the parameter with the reference 4; others do nothing."""

    def edit(text: str) -> str:
        form = REAL if fmi == 2 else FLOAT
        more = "".join(form.format(*parameter) for parameter in parameters)
        text = text.replace("</ModelVariables>", f"{more}</ModelVariables>")
        text = text.replace("</ModelStructure>", f"{depends}</ModelStructure>")
        return text.replace('name="q"', f'name="{q}"') if q else text

    path = build_talker(path / "talker.fmu", fmi, start="0.5", edit=edit)
    return open_archive(path, "talker.fmu")


def started(archive: Archive, q: float, parameters: dict[str, Any], names: dict[str, str]) -> float:
    """Return where robot 7 starts that is to start at q."""
    none = np.zeros(1)
    still = Disturbance(none, none, *np.zeros((3, 1, 0)))
    one = np.eye(1)
    body = Body(7, parameters, one, one, still, np.array([q]), none, none, none)
    with ExitStack() as stack:
        return float(open_plants(stack, archive, [body], names).q[0, 0])


def start_text(archive: Archive, q: float, names: dict[str, str]) -> str:
    with pytest.raises(FmuError) as error:
        started(archive, q, {}, names)
    message = str(error.value)
    assert message.startswith(
        f"talker.fmu: q of robot 7 was to start at [{q}] (initial.q), but starts at [0.5]; what "
        f"stands for q must be a state whose start can be set"
    )
    return message


FIRST, OTHER = ("origin", 4, 0.5, ""), ("gain", 3, 0.7, "")
CASES: dict[str, tuple[int, tuple[Any, ...], dict[str, str], dict[str, str], str]] = {
    "the same number": (2, (FIRST, OTHER), {}, {}, "origin"),
    "the same number, FMI 3": (3, (FIRST, OTHER), {}, {}, "origin"),
    "a name of two": (
        3, (("q_start", 4, 0.5, ""), ("gain", 3, 0.5, "")), {}, {}, "q_start",
    ),
    "a name below a prefix": (
        2, (("mass_s0", 4, 0.4, ""), OTHER), {"q": "mass.s"}, {"q": "mass.s"}, "mass_s0",
    ),
    "a name to be quoted": (2, (("q.start", 4, 0.5, ""), OTHER), {}, {}, "q.start"),
    "what it depends on": (
        2,
        (("zeta", 4, 0.2, ""), ("q_start", 3, 0.5, "")),
        {"depends": '<InitialUnknowns><Unknown index="1" dependencies="7"/></InitialUnknowns>'},
        {},
        "zeta",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_the_suggested_parameter_sets_the_start_value(tmp_path: Path, case: str) -> None:
    fmi, parameters, more, names, name = CASES[case]
    archive = talker(tmp_path, fmi, *parameters, **more)
    message = start_text(archive, 0.3, names)
    (table,) = re.findall(r"; a parameter seems to say it: plant\.(variables = \{ .* \})$", message)
    given = tomllib.loads(table)["variables"]
    assert given == {"q_start": name}
    assert started(archive, 0.3, {}, names | given) == 0.3


def test_a_suggested_parameter_is_in_its_own_unit(tmp_path: Path) -> None:
    units = (
        '<UnitDefinitions><Unit name="mm"><BaseUnit m="1" factor="0.001"/></Unit>'
        "</UnitDefinitions><ModelVariables>"
    )

    def edit(text: str) -> str:
        text = text.replace("<ModelVariables>", units)
        text = text.replace('<Real start="0"/>', '<Real start="0" unit="mm"/>', 1)
        return text.replace(
            "</ModelVariables>", REAL.format("q0", 4, 0.5, ' unit="mm"') + "</ModelVariables>"
        )

    path = build_talker(tmp_path / "talker.fmu", start="0.5", edit=edit)
    archive = open_archive(path, "talker.fmu")
    assert started(archive, 0.3, {}, {"q_start": "q0"}) == pytest.approx(0.3, rel=1e-15)
    with pytest.raises(FmuError, match="parameter q0 is among q_start, qd, which"):
        started(archive, 0.3, {"q0": 300.0}, {"q_start": "q0"})


@pytest.mark.parametrize(
    "parameters",
    [
        (("alpha", 4, 0.5, ""), ("omega", 3, 0.5, "")),
        (("alpha", 4, 0.4, ""), ("omega", 3, 0.3, "")),
        (("q_start", 4, 0.5, ' unit="deg"'),),
        (),
    ],
    ids=["two with the number", "none with the number", "of another unit", "none at all"],
)
def test_without_a_clear_parameter_none_is_suggested(
    tmp_path: Path, parameters: tuple[Any, ...]
) -> None:
    assert start_text(talker(tmp_path, 2, *parameters), 0.3, {}).endswith("can be set")


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("solver", ["cvode", "rk4"])
def test_a_continuous_state_starts_where_it_is_told_whatever_the_fmu_starts_it_from(
    tmp_path: Path, fmi: int, solver: Any
) -> None:
    """It swings by q'' = −q, so that q(t) = q_0 cos t."""
    archive = open_archive(hinge.build(fmi, tmp_path, start="0.25"))
    none, one = np.zeros(1), np.eye(1)
    still = Disturbance(none, none, *np.zeros((3, 1, 0)))
    parameters = {"inertia": 1.0}
    bodies = [
        Body(robot, parameters, one, 0 * one, still, np.array([q]), none, none, none)
        for robot, q in enumerate((0.25, 0.75, -2.0), 1)
    ]
    with ExitStack() as stack:
        plants = open_plants(stack, archive, bodies, {}, Driving(solver=solver))
        assert plants.q[:, 0].tolist() == [0.25, 0.75, -2.0]
        plants.advance(0.0, 1.0)
        np.testing.assert_allclose(plants.q[:, 0] / np.cos(1.0), [0.25, 0.75, -2.0], rtol=1e-6)


def test_a_check_proposes_names_and_starts_by_which_it_passes(tmp_path: Path) -> None:
    def edit(text: str) -> str:
        parameter = REAL.format("mass_s0", 4, 0.4, "")
        text = text.replace("</ModelVariables>", f"{parameter}</ModelVariables>")
        for ours, theirs in {"q": "mass.s", "qd": "mass.v", "tau": "force"}.items():
            text = text.replace(f'name="{ours}"', f'name="{theirs}"')
        return text

    archive = open_archive(build_talker(tmp_path / "mass.fmu", start="0.5", edit=edit))
    names: dict[str, str] = {}
    for finding, name in (("proposal", "q"), ("start", "q_start")):
        assert name not in names
        (text,) = [
            f.text for f in check(CheckTask(archive, names=names)).findings if f.name == finding
        ]
        names = tomllib.loads(text[text.index("variables = ") :])["variables"]
    assert names == {"q": "mass.s", "qd": "mass.v", "tau": "force", "q_start": "mass_s0"}
    checked = check(CheckTask(archive, names=names))
    assert checked.passes
    assert "start" not in {finding.name for finding in checked.findings}


RAD, SPEED, TORQUE = ' unit="rad"', ' unit="rad/s"', ' unit="N.m"'
UNITS = (
    '<UnitDefinitions><Unit name="rad"><BaseUnit rad="1"/></Unit><Unit name="rad/s"><BaseUnit '
    'rad="1" s="-1"/></Unit><Unit name="N.m"><BaseUnit kg="1" m="2" s="-2"/></Unit>'
    "</UnitDefinitions>"
)
FAMILIES: dict[str, tuple[list[tuple[str, str, str]], dict[str, Any] | None]] = {
    "an index inside": (
        [("j1.phi", "output", ""), ("j2.phi", "output", ""), ("j1.w", "output", ""),
         ("j2.w", "output", ""), ("j1.u", "input", ""), ("j2.u", "input", "")],
        {"q": {"pattern": "j{i}.phi", "base": 1}, "qd": {"pattern": "j{i}.w", "base": 1},
         "tau": {"pattern": "j{i}.u", "base": 1}},
    ),
    "only units tell": (
        [("a0", "output", RAD), ("a1", "output", RAD), ("b0", "output", SPEED),
         ("b1", "output", SPEED), ("c0", "input", TORQUE), ("c1", "input", TORQUE)],
        {"q": {"pattern": "a{i}", "base": 0}, "qd": {"pattern": "b{i}", "base": 0},
         "tau": {"pattern": "c{i}", "base": 0}},
    ),
    "references": (
        [("angle", "output", RAD), ("speed", "output", SPEED), ("in1", "input", RAD),
         ("in2", "input", SPEED)],
        {"q": "angle", "qd": "speed", "position_ref": "in1", "velocity_ref": "in2"},
    ),
    "nothing tells": (
        [("a", "output", ""), ("b", "output", ""), ("c", "input", "")], None,
    ),
    "of unequal lengths": (
        [("phi[1]", "output", RAD), ("phi[2]", "output", RAD), ("w", "output", SPEED),
         ("torque", "input", TORQUE)], None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", FAMILIES)
def test_families_of_equal_length_are_proposed(tmp_path: Path, case: str) -> None:
    variables, wanted = FAMILIES[case]
    text = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}">'
        f"<Real{unit}/></ScalarVariable>"
        for i, (name, causality, unit) in enumerate(variables)
    )
    units = re.sub("</?UnitDefinitions>", "", UNITS)
    archive = open_archive(with_variables(tmp_path / "a.fmu", 2, text, units))
    lines = [as_line(g.names) for group in proposals(archive, {})[:1] for g in group]
    assert [tomllib.loads(line)["variables"] for line in lines] == ([wanted] if wanted else [])
