"""What is kept of a URDF can be drawn: what of it is no number is left out, with a warning."""

import pytest

from nrs_cosim.recordings.robots.description import parse_urdf
from tests.plant_fmu.urdf_texts import joint, link, reader, robot

BALL = '<sphere radius="0.2"/>'
LOOK = "link 'arm': <visual> {}; this look is left out"
FAULTY_LOOKS = {
    "an infinite size": ("", '<box size="0.1 inf 0.1"/>', "<box> size: expected 3 numbers, got"),
    "no number": ("", '<sphere radius="nan"/>', "<sphere> radius: expected a number, got 'nan'"),
    "a negative length": (
        "",
        '<cylinder radius="0.1" length="-1"/>',
        "<cylinder> length: expected a number from 0, got '-1'",
    ),
    "none at all": ("", "<sphere/>", "<sphere> radius: expected a number, got ''"),
    "two of three": ("", '<box size="1 1"/>', "<box> size: expected 3 numbers, got '1 1'"),
    "too large": ("", '<sphere radius="1e40"/>', "<sphere> radius: expected a number up to 1e+30"),
    "a place": ('<origin xyz="0 0 ${z}"/>', BALL, "<origin> xyz: expected 3 numbers, got"),
    "a turn": ('<origin rpy="0 nan 0"/>', BALL, "<origin> rpy: expected 3 numbers, got '0 nan 0'"),
    "a mesh's scale": (
        "",
        '<mesh filename="package://a/b.stl" scale="1 inf 1"/>',
        "<mesh> scale: expected 3 numbers, got '1 inf 1'",
    ),
}


@pytest.fixture
def read(tmp_path):
    return reader(tmp_path)


def looks(*parts):
    """Return an arm that has looks, and a ball that is sound."""
    visuals = "".join(f"<visual>{part}</visual>" for part in parts)
    arm = link("arm").replace("</link>", f"{visuals}</link>")
    return robot(arm, joint("j", "base", "arm"))


@pytest.mark.parametrize("case", FAULTY_LOOKS)
def test_a_look_that_cannot_be_drawn_is_left_out_and_named(read, case):
    origin, shape, wrong = FAULTY_LOOKS[case]
    sound = f"<geometry>{BALL}</geometry>"
    found = read(looks(f"{origin}<geometry>{shape}</geometry>", sound))
    (warning,) = found.warnings
    assert warning.startswith(f"link 'arm': <visual> {wrong}")
    assert warning.endswith("; this look is left out")
    (drawn,) = parse_urdf(found.text, "kept").shapes["arm"]
    assert (drawn.kind, drawn.size) == ("sphere", (0.2,))


def test_a_colour_that_is_none_is_left_out_of_a_look_that_stays(read):
    red = '<material name="red"><color rgba="1 0 0 nan"/></material>'
    found = read(looks(f"<geometry>{BALL}</geometry>{red}"))
    wrong = "<color> rgba: expected 4 numbers, got '1 0 0 nan'; it is left out"
    assert found.warnings == (f"link 'arm': {wrong}",)
    assert b"rgba" not in found.text
    assert len(parse_urdf(found.text, "kept").shapes["arm"]) == 1


def test_limits_that_are_infinite_stay_none_and_what_is_no_number_is_told(read):
    limit = '<limit lower="-inf" upper="INF" effort="nine" velocity="3"/>'
    found = read(robot(link("arm"), joint("j", "base", "arm", limit=limit)))
    assert found.warnings == (
        "joint 'j': <limit> effort: expected a number, got 'nine'; it is left out",
    )
    assert b'<limit lower="-1e+30" upper="1e+30" velocity="3"/>' in found.text


def test_a_fixed_joint_whose_axis_is_none_is_drawn(read):
    hand = joint("k", "arm", "hand", "fixed", axis="0 nan 0")
    found = read(robot(link("arm"), link("hand"), joint("j", "base", "arm"), hand))
    assert "joint 'k': <axis> xyz: expected 3 numbers, got '0 nan 0'" in found.warnings[0]
    assert parse_urdf(found.text, "kept").links == ("base", "arm", "hand")
