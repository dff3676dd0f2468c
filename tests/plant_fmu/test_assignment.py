"""Parameters reach the FMU in its types, structural ones first; what cannot be given is refused."""

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive, unpacked
from nrs_cosim.plant_fmu.archives.quantities import Part, Quantity
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.fmi.instances import Instances
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.plant_fmu.rewritten_fmus import reals, rewritten, with_variables
from tests.plant_fmu.talker import build_talker
from tests.plant_fmu.typed_fmu import build_typed

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

NAMES = {"q": "x[0:2]", "qd": "x[2:4]", "position_ref": "u[0:2]", "velocity_ref": "u[2:4]"}


@pytest.fixture(scope="module")
def typed(tmp_path_factory: pytest.TempPathFactory) -> Archive:
    return open_archive(build_typed(tmp_path_factory.mktemp("typed")), "typed.fmu")


@pytest.fixture
def given(typed: Archive) -> Callable[..., list[float]]:
    """Return a function that gives an instance parameters, and reads a variable back."""

    def read(parameters: dict[str, Any], reference: int, length: int = 1) -> list[float]:
        with ExitStack() as stack:
            library = stack.enter_context(
                Library(typed, stack.enter_context(unpacked(typed)), "CoSimulation")
            )
            bodies = [body(parameters)]
            instances = Instances(library, bodies, {})
            instances.initialise(bodies, [{"kp": np.eye(2)}])
            rows = np.empty((1, length))
            part = Part(reference, length, 0, length, 1.0, ())
            instances.reads([Quantity("read", (part,))], rows)(0.0)
            return rows[0].tolist()

    return read


def body(parameters: dict[str, Any]) -> Body:
    none = np.zeros(2)
    return Body(
        robot=1,
        parameters=parameters,
        kp=np.eye(2),
        kd=np.eye(2),
        disturbance=Disturbance(none, none, *np.zeros((3, 2, 0))),
        q=np.array([5.0, 6.0]),
        qd=np.array([7.0, 8.0]),
        position=none,
        velocity=none,
    )


@pytest.mark.parametrize(
    ("name", "value", "reference", "read"),
    [
        ("brake", True, 6, [1]),
        ("gear", -3, 7, [-3]),
        ("gear", np.int64(7), 7, [7]),
        ("mode", "free", 8, [4]),
        ("mode", 1, 8, [1]),
        ("table", "ab", 9, [ord("a") + ord("b")]),
        ("ratios", [1, 2.5, 3, 4], 10, [1, 2.5, 3, 4]),
        ("pins", [[1, 2], [3, 255]], 11, [1, 2, 3, 255]),
        ("pins", [1, 2, 3, 4], 11, [1, 2, 3, 4]),
        ("kd", np.array([[1.0, 2.0], [3.0, 4.0]]), 4, [1, 2, 3, 4]),
        ("n", 6, 0, [6]),
    ],
)
def test_a_parameter_is_set_in_the_variables_type(given, name, value, reference, read):
    assert given({name: value}, reference, len(read)) == read


def test_structural_parameters_are_set_first_and_decide_sizes(typed, given):
    assert given({"ratios": [1.0, 2.0], "n": 2}, 10, 2) == [1, 2]
    assert sizes_of(assignments(typed, {"ratios": [1.0, 2.0], "n": 2})) == {0: 2}


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("brake", 1, "brake is of type Boolean, expected true or false, got 1"),
        ("gear", 1.0, "gear is of type Int32, expected a whole number, got 1.0"),
        ("gear", True, "gear is of type Int32, expected a whole number, got True"),
        ("gear", 1 << 31, "gear is of type Int32, expected a number of 32 bits, got 2147483648"),
        ("pins", [[1, 2], [3, -1]], "pins is of type UInt8, expected a number of 8 bits, got -1"),
        ("pins", [1, 2, 3], "pins takes 2 x 2 values, got 3"),
        ("pins", [[1, 2, 3, 4]], "pins takes 2 x 2 values, got 1 x 4"),
        (
            "pins",
            [[1], [2], [3], [4, 5]],
            "pins is of type UInt8, expected a whole number, got [1]",
        ),
        ("ratios", 1.0, "ratios takes 4 values, got 1"),
        ("ratios", [1, 2, 3, "4"], "ratios is of type Float32, expected a number, got '4'"),
        ("kp", [[True, 0], [0, 1]], "kp is of type Float64, expected a number, got True"),
        ("gear", [1, 2], "gear takes 1 value, got 2"),
        ("mode", "fre", "mode is of type Enumeration, expected servo, free, got 'fre'"),
        ("mode", 2, "mode is of type Enumeration, expected servo, free, got 2"),
        ("mode", 1.0, "mode is of type Enumeration, expected servo, free, got 1.0"),
        ("table", 3, "table is of type String, expected a text, got 3"),
        ("table", "a\0b", "table is of type String, expected a text, got 'a\\x00b'"),
        ("gearr", 1, "has no parameter 'gearr'; did you mean 'gear'?"),
        ("sum", 1.0, "'sum' cannot be set: it is calculated from other parameters"),
        ("tau_applied", [1, 2], "'tau_applied' cannot be set: it is an output that the FMU"),
        ("energy", 1.0, "'energy' cannot be set: it is a local that the FMU calculates"),
        ("pi", 3.0, "'pi' cannot be set: it is a constant"),
        ("time", 3.0, "'time' cannot be set: it is the time"),
        ("blob", "00", "'blob' cannot be set: it is of type Binary"),
    ],
)
def test_an_impossible_parameter_is_refused_with_the_reason(typed, name, value, message):
    with pytest.raises(FmuError) as error:
        assignments(typed, {name: value})
    assert str(error.value).startswith(f"typed.fmu: {message}")


def test_a_parameter_refused_by_the_fmu_names_parameter_and_robot(tmp_path):
    def whole(text: str) -> str:
        return re.sub(
            r'(name="m1".*?)<Real unit="kg"[^>]*>', r'\1<Integer start="1"/>', text, flags=re.DOTALL
        )

    archive = open_archive(rewritten(tmp_path / "arm.fmu", 2, whole), "arm.fmu")
    with ExitStack() as stack:
        message = r"arm\.fmu: setting m1 of robot 1 ended with Error"
        with pytest.raises(FmuError, match=message):
            open_plants(stack, archive, [body({"m1": 2})], {})


def test_a_family_of_parameters_takes_a_list(tmp_path):
    xml = reals("m1", "m2", "k[1,1]", "k[1,2]", "arm.l1", "arm.l2").replace(
        "<ScalarVariable", '<ScalarVariable causality="parameter" variability="fixed"'
    )
    archive = open_archive(with_variables(tmp_path / "arm.fmu", 2, xml), "arm.fmu")
    first, second = assignments(archive, {"m": [1.0, 2.0], "k": [[3.0, 4.0]]})
    assert (first.references, list(first.values)) == ((0, 1), [1, 2])
    assert (second.references, list(second.values)) == ((2, 3), [3, 4])
    with pytest.raises(FmuError, match=r"has no parameter 'l'"):
        assignments(archive, {"l": [1.0, 2.0]})


def test_what_an_fmu_has_for_a_parameter_is_parameters_alone(tmp_path):
    text = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}" '
        f'variability="{variability}"><Real start="0"/></ScalarVariable>'
        for i, (name, causality, variability) in enumerate(
            [("u", "input", "continuous"), ("load", "parameter", "fixed")]
        )
    )
    archive = open_archive(with_variables(tmp_path / "a.fmu", 2, text), "a.fmu")
    with pytest.raises(FmuError, match=r"has no parameter 'mass'; it has load\.$"):
        assignments(archive, {"mass": 1.0})


def test_slices_of_arrays_are_set_and_read(typed):
    """A step makes x what u is; what of u is not ours stays as it is."""
    with ExitStack() as stack:
        plants = open_plants(stack, typed, [body({"n": 4})], NAMES)
        assert plants.q.tolist() == [[5, 6]]
        assert plants.qd.tolist() == [[7, 8]]
        plants.hold(np.array([[1.5, 2.5]]), np.array([[3.5, 4.5]]))
        plants.advance(0.0, 0.1)
        assert plants.q.tolist() == [[1.5, 2.5]]
        assert plants.qd.tolist() == [[3.5, 4.5]]
        names = {**NAMES, "position_ref": "u[4:6]", "qd": "x[4:6]"}
        plants = open_plants(stack, typed, [body({"n": 6})], names)
        plants.hold(np.array([[1.5, 2.5]]), np.array([[3.5, 4.5]]))
        plants.advance(0.0, 0.1)
        assert plants.q.tolist() == [[0, 0]]
        assert plants.qd.tolist() == [[1.5, 2.5]]
        with pytest.raises(FmuError, match=r"x\[2:4\] for qd is beyond the 3 numbers"):
            open_plants(stack, typed, [body({"n": 3})], NAMES)
        with pytest.raises(FmuError, match="q and qd stand for the same number"):
            open_plants(stack, typed, [body({"n": 4})], {**NAMES, "qd": "x[1:3]"})


def test_parameters_of_other_types_may_have_the_references_of_quantities(tmp_path):
    archive = open_archive(build_talker(tmp_path / "talker.fmu"), "talker.fmu")
    numbers = {v.name: v.valueReference for v in archive.description.modelVariables}
    assert (numbers["debug"], numbers["level"]) == (numbers["q"], numbers["tau"])
    none = np.zeros(1)
    still = Disturbance(none, none, *np.zeros((3, 1, 0)))
    one = Body(1, {"debug": True, "level": 2}, np.eye(1), np.eye(1), still, none, none, none, none)
    with ExitStack() as stack:
        plants = open_plants(stack, archive, [one], {})
        plants.hold(np.ones((1, 1)), none[None])
        plants.advance(0.0, 0.1)
        assert plants.q[0, 0] > 0.0


# What is given to, and read from, FMUs that are initialised


@pytest.fixture
def two(typed: Archive) -> Iterator[Instances]:
    """Yield two robots' FMUs, initialised; their input u is variable 1, of four numbers."""
    with ExitStack() as stack:
        folder = stack.enter_context(unpacked(typed))
        library = stack.enter_context(Library(typed, folder, "CoSimulation"))
        bodies = [replace(body({}), robot=robot) for robot in (3, 8)]
        instances = Instances(library, bodies, {})
        instances.initialise(bodies, [{"kp": np.eye(2)}] * 2)
        yield instances


def stretch(first: int, size: int, length: int = 4) -> list[Quantity]:
    return [Quantity("u", (Part(1, length, first, size, 1.0, ()),))]


def test_setting_a_slice_leaves_the_rest_of_the_array(two: Instances) -> None:
    whole = np.arange(8.0).reshape(2, 4) + 1
    two.writes(stretch(0, 4), whole)(0.0)
    two.writes(stretch(1, 2), np.array([[70.0, 80.0], [71.0, 81.0]]))(0.0)
    found = np.empty((2, 4))
    two.reads(stretch(0, 4), found)(0.0)
    assert found.tolist() == [[1, 70, 80, 4], [5, 71, 81, 8]]


@pytest.mark.parametrize("act", ["reads", "writes"])
def test_a_refused_access_names_robot_time_and_variable(two: Instances, act: str) -> None:
    words = r"robot 3 \(typed\.fmu\) at t = 0\.25 s: access to .*u.* ended with Error"
    with pytest.raises(StepError, match=words):
        getattr(two, act)(stretch(0, 3, length=3), np.zeros((2, 3)))(0.25)


def test_a_disturbance_without_variables_in_the_fmu_is_refused(typed: Archive) -> None:
    one, none = np.ones(2), np.zeros((2, 0))
    disturbed = replace(body({"n": 4}), disturbance=Disturbance(one, one, none, none, none))
    words = r"typed\.fmu: cannot take the disturbance of robot 1: .* it has no variable disturb"
    with ExitStack() as stack, pytest.raises(FmuError, match=words):
        open_plants(stack, typed, [disturbed], NAMES)


def test_more_waves_than_the_fmu_has_room_for_are_refused() -> None:
    archive = open_archive(build("two_link_arm"))
    waves = Disturbance(np.zeros(2), np.zeros(2), *np.ones((3, 2, 99)))
    disturbed = replace(body({}), disturbance=waves)
    words = r"takes up to \d+ sines and cosines of a disturbance on an axis, got 99 for robot 1"
    with ExitStack() as stack, pytest.raises(FmuError, match=words):
        open_plants(stack, archive, [disturbed], {})
