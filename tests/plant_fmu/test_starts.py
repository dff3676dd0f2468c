"""A start that cannot be set: which parameter brings it about is told, and does."""

import re
import shutil
import tomllib
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
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
    assert "; its start seems to be a parameter's: leave initial.q as it is, and give " in message
    (table,) = re.findall(r"give robot 7 plant\.(parameters = \{ .* \})$", message)
    given = tomllib.loads(table)["parameters"]
    assert given == {name: 0.3}
    assert started(archive, 0.3, given, names) == 0.3


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
    with pytest.raises(FmuError, match=r"plant\.parameters = \{ q0 = 300\.0 \}$"):
        started(archive, 0.3, {}, {})
    assert started(archive, 0.3, {"q0": 300.0}, {}) == pytest.approx(0.3, rel=1e-15)


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
