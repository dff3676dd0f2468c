"""Whatever a tool calls its variables, they are found, or the error says what to write."""

import re
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count
from math import pi
from pathlib import Path

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.archives.families import NamePattern, Spec, families
from nrs_cosim.plant_fmu.archives.quantities import NumberLayout
from nrs_cosim.plant_fmu.archives.units import si_factor
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.plants import Array, Body, Disturbance
from nrs_cosim.plant_fmu.unit_names import parse_unit
from tests.plant_fmu.rewritten_fmus import description, reals, renamed, rewritten, with_variables

DEG = '<Unit name="deg"><BaseUnit rad="1" factor="0.017453292519943295"/></Unit>'


@pytest.fixture
def fmu(tmp_path: Path) -> Callable[..., Archive]:
    """Return a function that opens an FMU 2 with variables of these names, or an FMU with XML."""
    numbers = count()

    def opened(
        *names: str, fmi: int = 2, xml: str = "", units: str = "", unit: str = ""
    ) -> Archive:
        path = tmp_path / f"{next(numbers)}.fmu"
        with_variables(path, fmi, xml or reals(*names, unit=unit), units)
        return open_archive(path, "arm.fmu")

    return opened


def references(archive: Archive, name: str = "q", spec: Spec | None = None, **more) -> list[int]:
    quantity = find_quantity(archive, name, {} if spec is None else {name: spec}, **more)
    return [part.reference for part in quantity.parts]


def refused(archive: Archive, name: str = "q", spec: Spec | None = None, **more) -> str:
    with pytest.raises(FmuError) as error:
        references(archive, name, spec, **more)
    assert str(error.value).startswith("arm.fmu: ")
    return str(error.value).removeprefix("arm.fmu: ")


# Families


@pytest.mark.parametrize("base", [0, 1])
@pytest.mark.parametrize("prefix", ["", "arm.", "robot.arm[2]."])
@pytest.mark.parametrize("style", ["q[{}]", "q({})", "q_{}", "q{}", "q.{}", "q[{},BASE]"])
def test_a_family_is_found_in_any_style_and_order(fmu, style, prefix, base):
    names = [prefix + style.replace("BASE", str(base)).format(base + i) for i in (10, 2, 0, 1)]
    rest = [prefix + style.replace("BASE", str(base)).format(base + i) for i in range(3, 10)]
    archive = fmu("time", *names, *rest, "qd[1]", "x_q1", "q_", "dq1")
    assert references(archive) == [3, 4, 2, *range(5, 12), 1]


def test_a_matrix_is_read_row_by_row(fmu):
    archive = fmu("kp[2,1]", "kp[1,2]", "kp[2,2]", "kp[1,1]", "kd(1, 1)", "kd[0,0]")
    assert references(archive, "kp") == [3, 1, 0, 2]
    assert references(archive, "kd") == [5]


@pytest.mark.parametrize(
    ("names", "may_be"),
    [
        (
            ("q[1]", "q[2]", "arm.q[1]", "arm.q[2]"),
            "'q' may be arm.q[1], arm.q[2] or q[1], q[2]; write in the scenario's [plant]: "
            'variables.q = { pattern = "arm.q[{i}]", base = 1 } or '
            'variables.q = { pattern = "q[{i}]", base = 1 }',
        ),
        (("q_1", "q1"), "'q' may be q_1 or q1; write"),
        (
            ("joint1.q", "joint2.q"),
            "'q' may be joint1.q or joint2.q; write in the scenario's [plant]: "
            'variables.q = "joint1.q" or variables.q = "joint2.q"',
        ),
    ],
)
def test_two_matching_families_are_refused_with_what_to_write(fmu, names, may_be):
    assert refused(fmu(*names)).startswith(may_be)


def test_the_advice_on_an_ambiguity_resolves_it(fmu):
    archive = fmu("q[1]", "q[2]", "arm.q[0]", "arm.q[1]", "j1.q")
    specs = [
        family.spec
        for family in families("q", [v.name for v in archive.description.modelVariables])
    ]
    assert sorted(references(archive, spec=spec) for spec in specs) == [[0, 1], [2, 3], [4]]


def test_aliases_are_not_an_ambiguity(fmu):
    xml = reals("q[1]", "q[2]") + reals("arm.q[1]", "arm.q[2]")
    assert references(fmu(xml=xml)) == [0, 1]


def test_variables_of_another_type_are_no_aliases(fmu):
    whole = reals("arm.q[1]", "arm.q[2]").replace("<Real/>", '<Integer start="0"/>')
    message = refused(fmu(xml=whole + reals("q[1]", "q[2]")))
    assert message.startswith("'q' may be arm.q[1], arm.q[2] or q[1], q[2]; write")
    items = whole.replace("<Integer", "<Enumeration").replace("arm.", "j1.")
    message = refused(fmu(xml=whole + items + reals("other")))
    assert message.startswith("variable 'arm.q[1]' for q is of type Integer")


def test_an_exact_name_is_preferred_to_families(fmu):
    assert references(fmu("q", "q[1]", "q[2]", "arm.q")) == [0]
    assert references(fmu("time", "arm.q")) == [1]


@pytest.mark.parametrize(
    "names", [("q1", "q3"), ("q2", "q3"), ("q[1,1]", "q[2,2]"), ("q01", "q02")]
)
def test_a_family_with_a_gap_is_not_matched(fmu, names):
    assert "has no variable 'q'" in refused(fmu(*names))


def test_a_repeated_name_is_refused(fmu):
    archive = fmu(xml=reals("q", "q") + reals("v1", "v2", "v1"))
    assert refused(archive) == "has 2 variables named 'q'"
    assert refused(archive, "v") == "has 2 variables named 'v1'"


# What a user writes


def test_a_user_may_write_a_list_a_pattern_a_stem_or_a_slice(fmu):
    archive = fmu("b.phi", "a.phi", "j0.w", "j1.w", "x[1]", "x[2]", "x[3]", "M(1,1)", "M(1,2)")
    for spec, expected in {
        ("a.phi", "b.phi"): [1, 0],
        NamePattern("j{i}.w", 0): [2, 3],
        NamePattern("M({i},{j})"): [7, 8],
        "x": [4, 5, 6],
        "x[0:2]": [4, 5],
        "x[2:]": [6],
        "x[:1]": [4],
        "x[2]": [5],
    }.items():
        assert references(archive, spec=spec) == expected, spec


@pytest.mark.parametrize(
    ("spec", "message"),
    [
        ("phi3", "has no variable 'phi3' for q; did you mean 'a.phi2' or 'a.phi1'?"),
        (("a.phi1", "a.phi3"), "has no variable 'a.phi3'; did you mean"),
        (NamePattern("b{i}"), "has no variable 'b{i}' for q"),
        ("a.phi[1:3]", "'a.phi[1:3]' is beyond the 2 entries that it has"),
        ("a.phi[2:2]", "'a.phi[2:2]' is beyond"),
        ("b[0:2]", "has no variable 'b[0:2]' for q"),
        ("w[0:2]", "w[0:2] for q is beyond the 1 numbers of 'w'"),
    ],
)
def test_an_unknown_name_is_reported_with_the_nearest(fmu, spec, message):
    assert message in refused(fmu("a.phi1", "a.phi2", "w"), spec=spec)


def test_a_wrong_size_names_the_structural_parameter_that_decides_it():
    archive = open_archive(build("n_link_arm"), "arm.fmu")
    for size in (2, 4):
        assert refused(archive, size=size) == (
            f"q takes {size} numbers here, one for each of the scenario's target.axes, but the FMU "
            f"has 3: q; set its structural parameter: parameters = {{ n = {size} }}"
        )
    assert references(archive, size=2, sizes=sizes_of(assignments(archive, {"n": 2})))


def test_no_match_is_reported_with_what_to_write(fmu):
    assert refused(fmu("phi1", "phi2")) == (
        "has no variable 'q'; it has phi1, phi2. Write in the scenario's [plant]: "
        'variables.q = "its name", or a list of names, or { pattern = "q[{i}]", base = 1 }; '
        "`nrs fmu check arm.fmu` proposes a line"
    )


def test_a_wrong_size_is_reported_with_how_to_take_a_slice(fmu):
    archive = fmu("q1", "q2", "q3")
    assert refused(archive, size=2) == (
        "q takes 2 numbers here, one for each of the scenario's target.axes, but the FMU has 3: "
        "q1, q2, q3; "
        'a part of it would be variables.q = "q[0:2]"'
    )
    assert references(archive, spec="q[0:2]", size=2) == [0, 1]
    assert refused(archive, size=4) == (
        "q takes 4 numbers here, one for each of the scenario's target.axes, but the FMU has 3: "
        "q1, q2, q3"
    )


def test_without_qd_the_derivative_of_q_is_used(fmu):
    archive = fmu("j.q[1]", "j.q[2]", "der(j.q[1])", "der(j.q[2])", "a", "der(a)")
    assert references(archive, "qd") == [2, 3]
    assert [p.reference for p in find_quantity(archive, "qd", {"q": ("a",)}).parts] == [5]
    assert "has no variable 'qd'" in refused(fmu("q1", "q2", "der(q1)"), "qd")
    assert references(fmu("q1", "der(q1)", "qd1"), "qd") == [2]


# Arrays


def float64(name: str, reference: int, *dimensions: str, **attributes: str) -> str:
    said = "".join(f' {key}="{value}"' for key, value in attributes.items())
    lengths = "".join(f"<Dimension {dimension}/>" for dimension in dimensions)
    return f'<Float64 name="{name}" valueReference="{reference}"{said}>{lengths}</Float64>'


STATE = (
    '<UInt64 name="n" valueReference="9" causality="structuralParameter" start="4"/>'
    + float64("x", 1, 'valueReference="9"', start="1 2 3 4")
    + float64("q", 2, 'start="2"')
    + float64("A", 3, 'start="2"', 'valueReference="9"')
)


def test_structural_parameters_set_array_sizes(fmu):
    archive = fmu(fmi=3, xml=STATE)
    assert [find_quantity(archive, name).size for name in ("q", "x", "A")] == [2, 4, 8]
    assert [find_quantity(archive, n, sizes={9: 3}).size for n in ("q", "x", "A")] == [2, 3, 6]


def test_slices_of_one_array_share_its_variable(fmu):
    archive = fmu(fmi=3, xml=STATE)
    names = {"q": "x[2:4]", "qd": ("x[1:2]", "x[0:1]")}
    quantities = [find_quantity(archive, name, names, size=2) for name in ("q", "qd")]
    layout = NumberLayout.of(quantities)
    assert layout.references == (1,)
    assert layout.index.tolist() == [2, 3, 1, 0]
    assert layout.start.tolist() == [1, 2, 3, 4]
    assert layout.is_complete
    assert not NumberLayout.of(quantities[:1]).is_complete
    message = refused(archive, spec="x[3:5]")
    assert message == "x[3:5] for q is beyond the 4 numbers of 'x'"


@pytest.mark.parametrize("dimension", ['start="-1"', 'start="1000001"'])
def test_absurd_dimensions_are_refused(fmu, dimension):
    message = refused(fmu(fmi=3, xml=float64("q", 1, dimension)))
    assert "expected up to 1000000 numbers" in message


@pytest.mark.parametrize("kind", ["Float32", "Int32", "Boolean", "String"])
def test_a_state_must_be_a_real_variable(fmu, kind):
    message = refused(fmu(fmi=3, xml=f'<{kind} name="q" valueReference="1"/>'))
    assert f"'q' for q is of type {kind}" in message
    assert message.endswith("expected Real or Float64")


# Units


@pytest.mark.parametrize(
    ("unit", "definition", "name", "factor"),
    [
        ("", "", "q", 1),
        ("rad", "", "q", 1),
        ("deg", "", "q", pi / 180),
        ("deg/s", "", "qd", pi / 180),
        ("deg", 'rad="1" factor="0.0174"', "q", 0.0174),
        ("deg", 'factor="0.017453292519943295"', "q", pi / 180),
        ("rpm", "", "qd", pi / 30),
        ("rev/min", "", "qd", pi / 30),
        ("mm", 'm="1" factor="0.001"', "q", 0.001),
        ("kN.m", 'kg="1" m="2" s="-2" factor="1000"', "tau", 1000),
        ("N*m", "", "tau", 1),
        ("Nm", "", "tau", 1),
        ("kg.m2.s-2", "", "tau", 1),
        ("N.m/deg", 'kg="1" m="2" s="-2" rad="-1" factor="57.3"', "kp", 57.3),
        ("degC", 'K="1" offset="273.15"', "other", 1),
    ],
)
def test_units_are_converted_to_si(fmu, unit, definition, name, factor):
    units = f'<Unit name="{unit}"><BaseUnit {definition}/></Unit>' if definition else ""
    (part,) = find_quantity(fmu(name, unit=unit, units=units), name).parts
    assert part.factor == pytest.approx(factor, rel=1e-12)


@pytest.mark.parametrize(
    ("unit", "definition", "name", "reason"),
    [
        ("furlong", "", "q", "a unit that the FMU does not define"),
        ("Deg", "", "q", "a unit that the FMU does not define"),
        ("kN.m", "", "tau", "a multiple of an SI unit that the FMU does not define"),
        ("mrad", "", "q", "a multiple of an SI unit that the FMU does not define"),
        ("kg", "", "q", "expected rad or m, or a multiple"),
        ("rad", "", "tau", "expected N.m or N, or a multiple"),
        ("Hz", 's="-1"', "qd", "expected rad/s or m/s, or a multiple"),
        ("1/min", 's="-1" factor="0.01667"', "qd", "expected rad/s or m/s, or a multiple"),
        ("x", 'rad="1" offset="3"', "q", "it has an offset of 3"),
        ("x", 'rad="1" factor="0"', "q", "its definition is not one of a mechanical unit"),
        ("x", 'rad="1" factor="1e999"', "q", "its definition is not one of a mechanical unit"),
        ("x", 'rad="1" K="1"', "q", "its definition is not one of a mechanical unit"),
    ],
)
def test_a_unit_that_contradicts_is_refused(fmu, unit, definition, name, reason):
    units = f'<Unit name="{unit}"><BaseUnit {definition}/></Unit>' if definition else ""
    message = refused(fmu(name, unit=unit, units=units), name)
    assert message == f"variable '{name}' for {name} is in '{unit}': {reason}"


@pytest.mark.parametrize("unit", ["/", "N.(m)", "rad/s/", "²"])
def test_an_unreadable_unit_is_refused(unit):
    assert parse_unit(unit) is None
    with pytest.raises(ValueError, match="a unit that the FMU does not define"):
        si_factor(unit, [], ["rad"])


@pytest.mark.parametrize("unit", ["", "-"])
def test_a_dash_means_no_unit(unit):
    assert si_factor(unit, [], ["rad"]) == 1.0


def test_the_unit_of_a_declared_type_is_used(tmp_path):
    variable = (
        '<ScalarVariable name="q" valueReference="0"><Real declaredType="A"/></ScalarVariable>'
    )
    types = '<SimpleType name="A"><Real unit="deg"/></SimpleType>'
    archive = open_archive(with_variables(tmp_path / "a.fmu", 2, variable, DEG, types))
    assert find_quantity(archive, "q").parts[0].factor == pytest.approx(pi / 180)


# Runs


def body(scale: float = 1.0) -> Body:
    """Return a robot whose positions and velocities are scaled."""
    none = np.zeros(2)
    return Body(
        robot=1,
        parameters={"m2": 1.2, "J": [4.0, 5.0]},
        kp=np.array([[200.0, 7.0], [-3.0, 150.0]]),
        kd=np.array([[300.0, 5.0], [2.0, 250.0]]),
        disturbance=Disturbance(none + 0.3, none, *np.ones((3, 2, 1))),
        q=scale * np.array([0.4, -1.1]),
        qd=scale * np.array([2.0, -0.7]),
        position=scale * np.array([1.0, -0.5]),
        velocity=scale * np.array([0.5, 2.0]),
    )


def story(archive: Archive, names: dict[str, Spec], scale: float = 1.0) -> Array:
    """Return q, qd and tau of ten steps with a new reference before each."""
    with ExitStack() as stack:
        plants = open_plants(stack, archive, [body(scale)], names)
        rows = []
        for k in range(10):
            plants.hold(scale * np.array([[0.1 * k, 1.0]]), scale * np.array([[1.0, -0.2 * k]]))
            plants.advance(0.1 * k, 0.1)
            rows.append(np.concatenate([plants.q, plants.qd, plants.tau], axis=1)[0])
        return np.array(rows)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Array:
    """Return the story as the bundled names tell it."""
    path = tmp_path_factory.mktemp("plain") / "arm.fmu"
    return story(open_archive(rewritten(path, 2, str)), {})


STYLES: dict[str, tuple[Callable[[str, list[int]], str], dict[str, Spec]]] = {
    "parentheses": (lambda stem, ij: f"{stem}({','.join(map(str, ij))})", {}),
    "base 0": (lambda stem, ij: f"{stem}[{','.join(str(i - 1) for i in ij)}]", {}),
    "below a prefix": (lambda stem, ij: f"arm.{stem}[{','.join(map(str, ij))}]", {}),
    "plain digits": (
        lambda stem, ij: f"{stem}{ij[0]}" if len(ij) == 1 else f"{stem}[{ij[0]},{ij[1]}]",
        {},
    ),
    "underscores, q by a pattern, qd by names": (
        lambda stem, ij: {"q": f"j{ij[0]}.phi", "qd": f"w{'ab'[ij[0] - 1]}"}.get(
            stem, f"{stem}_{ij[0]}" if len(ij) == 1 else f"{stem}[{ij[0]},{ij[1]}]"
        ),
        {"q": NamePattern("j{i}.phi"), "qd": ("wa", "wb")},
    ),
}


@pytest.mark.parametrize(("name", "names"), STYLES.values(), ids=STYLES)
def test_renamed_variables_give_the_same_run(tmp_path, plain, name, names):
    path = rewritten(tmp_path / "arm.fmu", 2, lambda text: renamed(text, name))
    assert description(2) != renamed(description(2), name)
    assert story(open_archive(path), names).tolist() == plain.tolist()


def test_slices_of_one_family_give_the_same_run(tmp_path, plain):
    order = ("q", "qd", "tau_applied")

    def name(stem: str, ij: list[int]) -> str:
        if stem in order:
            return f"x[{2 * order.index(stem) + ij[0]}]"
        return f"{stem}[{','.join(map(str, ij))}]"

    archive = open_archive(rewritten(tmp_path / "arm.fmu", 2, lambda text: renamed(text, name)))
    with pytest.raises(FmuError, match=r"has no variable 'q'; it has time, tau, position_ref, "):
        find_quantity(archive, "q")
    names: dict[str, Spec] = {"q": "x[0:2]", "qd": "x[2:4]", "tau_applied": "x[4:6]"}
    assert story(archive, names).tolist() == plain.tolist()


def test_an_fmu_in_degrees_is_driven_and_recorded_in_radians(tmp_path, plain):
    """The arm's equations with its angles declared in degrees: the same numbers, another unit."""

    def in_degrees(text: str) -> str:
        angles = r'(name="(?:q|position_ref)\[.*?unit=")rad"'
        rates = r'(name="(?:qd|velocity_ref)\[.*?unit=")rad/s"'
        text = re.sub(angles, r'\1deg"', text, flags=re.DOTALL)
        return re.sub(rates, r'\1deg/s"', text, flags=re.DOTALL).replace(
            "</UnitDefinitions>", f"{DEG}</UnitDefinitions>"
        )

    path = rewritten(tmp_path / "arm.fmu", 2, in_degrees)
    expected = plain * ([pi / 180] * 4 + [1, 1])
    np.testing.assert_allclose(
        story(open_archive(path), {}, pi / 180), expected, rtol=1e-9, atol=1e-12
    )
