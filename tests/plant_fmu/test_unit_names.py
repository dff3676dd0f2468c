"""A unit's name is read once, for the FMUs that are built here and for those of others."""

from dataclasses import replace
from math import pi
from xml.etree.ElementTree import fromstring

import pytest

from nrs_cosim.plant_fmu.bundled.declaration import bundled_models, declaration
from nrs_cosim.plant_fmu.bundled.model_description import model_description
from nrs_cosim.plant_fmu.unit_names import has_multiple, parse_unit


@pytest.mark.parametrize(
    ("name", "factor", "exponents"),
    [
        ("kg.m2", 1, (1, 2, 0, 0)),
        ("N.m.s/rad", 1, (1, 2, -1, -1)),
        ("m/s/s", 1, (0, 1, -2, 0)),
        ("m.s^-2", 1, (0, 1, -2, 0)),
        ("1/s", 1, (0, 0, -1, 0)),
        ("deg/s", pi / 180, (0, 0, -1, 1)),
        ("rpm", 2 * pi / 60, (0, 0, -1, 1)),
        ("N*m", 1, (1, 2, -2, 0)),
    ],
)
def test_a_name_is_a_factor_and_exponents(name, factor, exponents):
    unit = parse_unit(name)
    assert unit.exponents == exponents
    assert unit.factor == pytest.approx(factor, rel=1e-15)


def test_a_multiple_is_distinguished_from_a_unit_and_from_none():
    assert [has_multiple(name) for name in ("kN.m", "mrad/s", "N.m", "furlong")] == [
        *(True, True),
        *(False, False),
    ]
    assert parse_unit("kN.m") is None


BASE_UNITS = {
    "N": {"kg": "1", "m": "1", "s": "-2"},
    "N/m": {"kg": "1", "s": "-2"},
    "N/s": {"kg": "1", "m": "1", "s": "-3"},
    "N.s/m": {"kg": "1", "s": "-1"},
    "N.m": {"kg": "1", "m": "2", "s": "-2"},
    "N.m/s": {"kg": "1", "m": "2", "s": "-3"},
    "N.m/rad/s": {"kg": "1", "m": "2", "s": "-3", "rad": "-1"},
    "N/m/s": {"kg": "1", "s": "-3"},
    "N.m/rad": {"kg": "1", "m": "2", "s": "-2", "rad": "-1"},
    "N.m.s/rad": {"kg": "1", "m": "2", "s": "-1", "rad": "-1"},
    "kg": {"kg": "1"},
    "kg.m2": {"kg": "1", "m": "2"},
    "m": {"m": "1"},
    "m/s": {"m": "1", "s": "-1"},
    "m/s2": {"m": "1", "s": "-2"},
    "m.s": {"m": "1", "s": "1"},
    "rad": {"rad": "1"},
    "rad.s": {"rad": "1", "s": "1"},
    "rad/s": {"s": "-1", "rad": "1"},
    "rad/s2": {"s": "-2", "rad": "1"},
    "s": {"s": "1"},
}
"""Of all units that bundled models have, as FMI 3.0.2, section 2.4.4, has them."""


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", bundled_models())
def test_a_bundled_models_units_are_defined_as_their_names_say(model, fmi):
    root = fromstring(model_description(declaration(model, fmi), fmi, "token", []))
    found = {unit.get("name"): unit.find("BaseUnit").attrib for unit in root.iter("Unit")}
    assert len(found) > 5
    assert found == {name: BASE_UNITS[name] for name in found}


@pytest.mark.parametrize("unit", ["deg", "furlong"])
def test_a_declared_unit_must_be_a_product_of_si_units(unit):
    model = declaration("planar_robot")
    first, *others = model.variables
    wrong = replace(model, variables=(replace(first, unit=unit), *others))
    with pytest.raises(ValueError, match=f"'{unit}': expected a product of SI units"):
        model_description(wrong, 3, "token", [])
