"""The fields of an algorithm's dataclass are its parameters; a faulty one is one line."""

import inspect
from dataclasses import KW_ONLY, InitVar, dataclass, field, make_dataclass
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
import pytest

from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.installed import bundled_algorithms, load_algorithm, parameters_of
from nrs_cosim.estimator_agents.parameters import declared_parameters, parameter


@dataclass(frozen=True)
class Law:
    missing: ClassVar[tuple[str, ...]] = ("hold",)
    alpha: float = parameter("gain on the positions", unit="1/s", above=0)
    leak: float = parameter("of the velocity", 0.25, least=0, below=1)
    _: KW_ONLY
    plain: float
    most: Annotated[int, "robots"] = parameter(
        "liars among those who are received", 2, least=0, most=9
    )
    held: bool = True
    mode: Literal["sum", "mean"] = parameter("how samples are combined", "mean")
    label: str = field(default_factory=lambda: "law")
    derived: float = field(init=False, default=0.0)


BY_NAME = {one.name: one for one in declared_parameters(Law, "law")}


def test_each_field_that_is_given_is_a_parameter_in_the_order_of_the_class():
    assert [*BY_NAME] == ["alpha", "leak", "plain", "most", "held", "mode", "label"]
    assert [name for name, one in BY_NAME.items() if one.required] == ["alpha", "plain"]
    assert [one.kind for one in BY_NAME.values()] == [float, float, float, int, bool, str, str]
    assert {n: one.default for n, one in BY_NAME.items() if not one.required} == {
        "leak": 0.25, "most": 2, "held": True, "mode": "mean", "label": "law",
    }  # fmt: skip
    assert BY_NAME["mode"].choices == ("sum", "mean")
    alpha, plain = BY_NAME["alpha"].declared, BY_NAME["plain"].declared
    assert (alpha.meaning, alpha.unit, alpha.bounds) == (
        "gain on the positions",
        "1/s",
        {"above": 0},
    )
    assert (plain.meaning, plain.unit, plain.bounds) == ("", "", {})


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("alpha", 1, 1.0), ("leak", 0, 0.0), ("plain", -1e300, -1e300), ("most", 9, 9),
        ("held", False, False), ("mode", "sum", "sum"), ("label", "", ""),
    ],
)  # fmt: skip
def test_a_value_within_its_bounds_is_taken_as_its_type(name, given, value):
    taken = BY_NAME[name].value(given)
    assert (taken, type(taken)) == (value, BY_NAME[name].kind)


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("alpha", 0, "greater than 0"),
        ("alpha", np.nan, "a finite number"),
        ("plain", -np.inf, "a finite number"),
        ("plain", 10**400, "a finite number"),
        ("alpha", "1", "a valid number"),
        ("alpha", True, "a valid number"),
        ("alpha", [1.0, 2.0], "a valid number"),
        ("leak", -1e-9, "greater than or equal to 0"),
        ("leak", 1, "less than 1"),
        ("most", 10, "less than or equal to 9"),
        ("most", 2.0, "a whole number"),
        ("most", True, "a whole number"),
        ("held", 1, "true or false"),
        ("mode", "max", "'sum' or 'mean'"),
        ("mode", ["sum"], "'sum' or 'mean'"),
        ("label", 3, "a text"),
    ],
)
def test_any_other_parameter_value_is_refused_with_what_was_expected(name, given, expected):
    with pytest.raises(ValueError, match=f"^{expected}$"):
        BY_NAME[name].value(given)


class Bare:
    alpha: float


class Forgotten(Law):
    gamma: float = 0.5  # no field: the decorator is missing


@dataclass
class Vector:
    gains: list[float]


@dataclass
class Numbered:
    mode: Literal[1, 2] = 1


@dataclass
class Unknown:
    gamma: "Gain"  # noqa: F821, that is what is wrong with it


@dataclass
class Outside:
    alpha: float
    gamma: float = parameter("gain", 2.5, above=0, below=2)


@dataclass
class Worded:
    gamma: float = "large"


@dataclass
class Endless:
    gamma: float = float("inf")


@dataclass
class Bounded:
    mode: str = parameter("how", "mean", least=0)


@dataclass
class Named:
    name: str = "law"


@dataclass
class Missing:
    missing: tuple[str, ...] = ("hold",)


@dataclass
class Thrown:
    gamma: float = field(default_factory=lambda: 1 / 0)


FAULTY = [
    (Bare, "class Bare:", "Bare: is no dataclass; put @dataclass(frozen=True) above the class"),
    (
        Forgotten,
        "gamma: float = 0.5",
        "Forgotten.gamma: is no field; put @dataclass(frozen=True) above",
    ),
    (
        Vector,
        "gains",
        "Vector.gains: expected a float, int, bool, str or Literal of texts, got list",
    ),
    (Numbered, "mode: Literal[1", "Numbered.mode: expected a float, int, bool, str or Literal of "),
    (Unknown, "gamma: ", "Unknown.gamma: NameError: name 'Gain' is not defined"),
    (Outside, "gamma: float = p", "Outside.gamma: its default: expected less than 2, got 2.5"),
    (Worded, "gamma: ", "Worded.gamma: its default: expected a valid number, got 'large'"),
    (Endless, "gamma: ", "Endless.gamma: its default: expected a finite number, got inf"),
    (Bounded, "mode: ", "Bounded.mode: bounds are of numbers, and this is a str"),
    (Named, "name: ", "Named.name: a parameter cannot be called name, which is a key of every"),
    (
        Missing,
        "missing: t",
        "Missing.missing: a parameter cannot be called missing, which is a key",
    ),
    (Thrown, "gamma: ", "Thrown.gamma: ZeroDivisionError: division by zero"),
]


@pytest.mark.parametrize(("kind", "line", "fault"), FAULTY, ids=[one[0].__name__ for one in FAULTY])
def test_a_class_that_declares_wrongly_is_one_line_with_its_place(kind, line, fault):
    with pytest.raises(AlgorithmError) as error:
        declared_parameters(kind, "law")
    said = str(error.value)
    assert said.startswith(f"algorithm.name: law: {fault}")
    lines, first = inspect.getsourcelines(kind)
    (at,) = [number for number, one in enumerate(lines, first) if one.strip().startswith(line)]
    if kind is not Bare:
        assert said.endswith(f", at {__file__}:{at}")
    assert "\n" not in said


def test_an_entry_point_that_is_no_class_is_refused():
    with pytest.raises(
        AlgorithmError, match=r"^algorithm.name: law: \S*lambda\S*: is no dataclass"
    ):
        declared_parameters(lambda alpha, beta: (alpha, beta), "law")


def test_init_only_fields_are_not_parameters():
    @dataclass
    class Built:
        scale: InitVar[float] = 1.0
        alpha: float = 0.5

    assert [one.name for one in declared_parameters(Built, "law")] == ["alpha"]


def test_a_class_made_of_another_has_its_parameters_too():
    @dataclass(frozen=True)
    class More(Law):
        gamma: float = parameter("gain on the accelerations", 0.5, above=0)

    assert [one.name for one in declared_parameters(More, "law")][-1] == "gamma"


def test_bundled_algorithms_declare_all_that_they_are_given():
    for name in bundled_algorithms():
        declared = parameters_of(name)
        assert all(one.declared.meaning for one in declared)
        given: dict[str, Any] = {one.name: 1.0 for one in declared}
        algorithm = load_algorithm(name, given)
        assert {one: getattr(algorithm, one) for one in given} == given


@pytest.mark.parametrize(
    ("kind", "bounds", "asked"),
    [
        (float, {"above": 1, "below": 1}, "greater than 1 and less than 1"),
        (float, {"least": 2, "most": 1.5}, "greater than or equal to 2 and less than or equal to"),
        (float, {"above": 1, "most": 1}, "greater than 1 and less than or equal to 1"),
        (float, {"above": float("nan")}, "greater than nan"),
        (int, {"above": 1, "below": 2}, "greater than 1 and less than 2"),
        (int, {"least": 1.2, "most": 1.8}, "greater than or equal to 1.2 and less than or equal"),
    ],
)
def test_bounds_that_no_number_is_within_are_the_class_s_fault(kind, bounds, asked):
    narrow = make_dataclass("Narrow", [("alpha", kind, parameter("gain", **bounds))], frozen=True)
    with pytest.raises(AlgorithmError, match=r"Narrow\.alpha: there is no number " + asked):
        declared_parameters(narrow, "narrow")


@pytest.mark.parametrize(
    ("kind", "bounds"),
    [
        (float, {"least": 1, "most": 1}),
        (float, {"above": 1, "below": 1 + 1e-15}),
        (int, {"above": 1, "below": 3}),
        (int, {"above": 0.5, "most": 1}),
        (float, {"above": 1}),
        (float, {"below": -1}),
        (float, {}),
    ],
)
def test_bounds_that_some_number_is_within_are_right(kind, bounds):
    law = make_dataclass("Law", [("alpha", kind, parameter("gain", **bounds))], frozen=True)
    assert declared_parameters(law, "law")[0].declared.bounds == bounds
