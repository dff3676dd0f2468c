"""What acts on a URDF's joints by itself, in closed form: rotors, dry friction and soft stops."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from nrs_cosim.plant_fmu.errors import FmuError
from tests.plant_fmu.urdf_texts import (
    LIMIT,
    NO_GRAVITY,
    dynamics,
    joint,
    link,
    mimic,
    reader,
    robot,
)

INERTIA = 0.1 + 0.1**2
"""kg m2, of a link of 1 kg about its joint's y."""


@pytest.fixture(scope="module", autouse=True)
def _extra():
    pytest.importorskip(
        "nrs_cosim.plant_fmu.bundled.rigid_body", reason="needs the packages of the extra urdf"
    )


@pytest.fixture
def read(tmp_path):
    return reader(tmp_path)


def pendulum(more="", limit=""):
    return robot(link("arm"), joint("j", "base", "arm", more=more, limit=limit))


ROTORS = {
    "Drake's": (
        '<drake:rotor_inertia value="2e-4"/><drake:gear_ratio value="50"/>',
        "",
    ),
    "beside the reduction": (
        "<rotorInertia>2e-4</rotorInertia><mechanicalReduction>-50</mechanicalReduction>",
        "",
    ),
    "the transmission's reduction": (
        '<motorInertia value="2e-4"/>',
        "<mechanicalReduction>50</mechanicalReduction>",
    ),
}


@pytest.mark.parametrize("case", ROTORS)
def test_a_rotor_adds_its_inertia_times_the_square_of_the_reduction(read, case):
    """To an arm, and to the finger that it leads by a factor 3, which has none of its own."""
    within, beside = ROTORS[case]
    transmission = (
        '<transmission name="t"><type>simple</type><joint name="{}"/>'
        f'<actuator name="m">{within}</actuator>{beside}</transmission>'
    )
    axis = joint("k", "arm", "finger", "prismatic", mimic("j", 3), xyz="0 0 0")
    text = robot(
        link("arm"),
        '<link name="finger"/>',
        joint("j", "base", "arm"),
        axis,
        transmission.format("j"),
        transmission.format("k"),
    )
    found = read(text.replace("<robot", '<robot xmlns:drake="http://drake.mit.edu"'))
    assert found.warnings == ()
    qdd = dynamics(found, NO_GRAVITY)([0.3], [0.7], [1.5])
    np.testing.assert_allclose(qdd, 1.5 / (INERTIA + 0.5 + 3**2 * 0.5), rtol=1e-14)


def test_a_rotor_of_two_joints_is_refused(read):
    both = '<transmission name="t"><joint name="j"/><joint name="k"/><actuator name="m">'
    text = pendulum().replace(
        "</robot>", f'{both}<motorInertia value="1"/></actuator></transmission></robot>'
    )
    with pytest.raises(FmuError, match=r"transmission 't': has a rotor, and so one joint is expec"):
        read(text)


def test_a_transmission_of_a_joint_that_is_missing_is_named_and_with_a_rotor_refused(read):
    def of(joint, rotor=""):
        moved = f'<transmission name="t"><joint name="{joint}"/><actuator name="m">{rotor}'
        return pendulum().replace("</robot>", f"{moved}</actuator></transmission></robot>")

    rotor = '<motorInertia value="1"/>'
    assert read(of("jj")).warnings == (
        "transmission 't': there is no joint 'jj'; did you mean 'j'?",
    )
    with pytest.raises(FmuError, match=r"'t': has a rotor, and there is no joint 'jj'; did you m"):
        read(of("jj", rotor))
    fixed = of("k", rotor).replace(
        "</robot>", f"{link('hand')}{joint('k', 'arm', 'hand', 'fixed')}</robot>"
    )
    (warning,) = read(fixed).warnings
    assert warning == "transmission 't': its rotor is left out, for its joint is fixed"


def test_dry_friction_is_smoothed_and_told_or_left_out(read):
    rough = pendulum('<dynamics friction="0.3" damping="0.2"/>')
    without, found = read(rough), read(rough, friction_speed=0.02)
    assert without.warnings == ("joint 'j': its dry friction of 0.3 is left out (--friction)",)
    assert found.warnings == (
        "dry friction over 0.02 rad/s or m/s damps what nearly rests at up to 1.4e+02 per s, and "
        "what follows that takes as short steps",
    )
    assert round(0.3 / 0.02 / INERTIA, -1) == 140
    for rate in (-3.0, -0.01, 0.0, 0.005, 0.02, 1.0):
        tau = 1.0 - 0.2 * rate
        qdd = dynamics(without, NO_GRAVITY)([0.1], [rate], [1.0])
        np.testing.assert_allclose(qdd, tau / INERTIA, rtol=1e-13)
        tau -= 0.3 * np.sin(np.arctan2(rate, 0.02))
        qdd = dynamics(found, NO_GRAVITY)([0.1], [rate], [1.0])
        np.testing.assert_allclose(qdd, tau / INERTIA, rtol=1e-13)


def test_a_joint_leaves_its_stop_as_hunt_and_crossley_say(read):
    """u/v - ln(1 + u/v) = -w/v - ln(1 - w/v) for a speed u of arrival, w of departure, v = 0.5."""
    found = read(pendulum(limit=LIMIT.format(-1, 0.5)), stop_frequency=20.0)
    qdd = dynamics(found, NO_GRAVITY)
    stiffness = INERTIA * (2 * np.pi * 20) ** 2
    np.testing.assert_allclose(qdd([0.51], [0.0], [0.0]), -0.01 * stiffness / INERTIA, rtol=1e-12)
    np.testing.assert_allclose(qdd([-1.02], [0.0], [0.0]), 0.02 * stiffness / INERTIA, rtol=1e-12)
    assert qdd([0.3], [0.4], [0.0]) == 0.0  # between the stops
    assert qdd([0.6], [-0.6], [0.0]) == 0.0  # they never hold
    for end, side, u in ((0.5, 1, 1.0), (-1, -1, 0.2)):

        def moved(_, x):
            return [x[1], float(qdd([x[0]], [x[1]], [0.0])[0])]

        def left(_, x, end=end, side=side):
            return side * (x[0] - end) + 1e-12

        left.terminal, left.direction = True, -1
        run = solve_ivp(moved, (0, 1), [end, side * u], events=left, rtol=1e-10, atol=1e-12)
        s = u / 0.5
        w = brentq(lambda w, s=s: -w - np.log1p(-w) - s + np.log1p(s), 1e-9, 1 - 1e-9)
        assert run.y[1, -1] == pytest.approx(-side * 0.5 * w, rel=1e-6)


@pytest.mark.parametrize("limit", ["<limit/>", "<limit lower='x' upper='1e999'/>", "<mesh/>"])
def test_a_joint_without_limits_has_no_stop(read, limit):
    found = read(pendulum(limit=limit), stop_frequency=20.0)
    assert found.warnings[0] == "joint 'j': has no limits that differ, and so no stops"
    assert found.joints[0].stop == 0.0


def test_a_joint_may_have_one_stop(read):
    found = read(pendulum(limit="<limit lower='-1' upper='1e999'/>"), stop_frequency=20.0)
    qdd = dynamics(found, NO_GRAVITY)
    assert qdd([9.0], [1.0], [0.0]) == 0.0
    assert qdd([-1.1], [0.0], [0.0]) == pytest.approx(0.1 * (2 * np.pi * 20) ** 2)
