"""What an FMU's variables may be: told joint by joint by their names, and tried."""

import json
import re
import shutil
import tomllib
from itertools import chain
from typing import Any

import pytest

from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.archives.proposals import as_line, proposals
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.procedure import findings
from tests.plant_fmu.rewritten_fmus import renamed, rewritten, with_variables

pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler")

JOINTS = ("shoulder", "elbow")
LEGS = [(side, joint) for side in ("left", "right") for joint in ("hip", "knee")]


def by_joint(
    q: str, qd: str, tau: str, joints: Any = JOINTS, more: tuple[str, ...] = ()
) -> tuple[list[str], list[str], Any]:
    """Return outputs, inputs and what is to be proposed, of one pattern each.

    What is declared is in another order for each quantity.
    """
    names = {
        ours: [pattern.format(*((j,) if isinstance(j, str) else j)) for j in joints]
        for ours, pattern in (("q", q), ("qd", qd), ("tau", tau))
    }
    outputs = [*more, *names["q"], *reversed(names["qd"])]
    return outputs, names["tau"][::-1], [names]


CASES: dict[str, tuple[list[str], list[str], Any]] = {
    "a common suffix": by_joint("{}_angle", "{}_speed", "{}_torque"),
    "a common prefix": by_joint("angle_{}", "speed_{}", "torque_{}"),
    "a place in the middle": by_joint("body.{}.phi", "body.{}.w", "body.{}.tau"),
    "capitals": by_joint("{}Angle", "{}AngleDot", "Torque{}", ("Shoulder", "Elbow")),
    "a prefix for each quantity": by_joint("y_{}_angle", "y_{}_speed", "u_{}_torque"),
    "words in an index": by_joint("phi[Joint.{}]", "w[Joint.{}]", "tau[Joint.{}]"),
    "inputs of the joints' names": by_joint("{}_angle", "{}_speed", "{}"),
    "joints of two words": by_joint("{}_{}_pos", "{}_{}_vel", "{}_{}_u", LEGS),
    "a joint on both sides": by_joint("{0}_q_{1}", "{0}_qd_{1}", "{0}_tau_{1}", LEGS),
    "others beside them": by_joint(
        "{}_angle", "{}_speed", "{}_torque",
        more=("ambient_angle", "shoulder_acceleration", "elbow_acceleration", "elbow_angle_ref"),
    ),
    "joints of two kinds": (
        ["shoulder_angle", "slide_position", "slide_velocity", "shoulder_speed"],
        ["slide_force", "shoulder_torque"],
        [{"q": ["shoulder_angle", "slide_position"], "qd": ["shoulder_speed", "slide_velocity"],
          "tau": ["shoulder_torque", "slide_force"]}],
    ),
    "references": (
        ["shoulder_angle", "elbow_angle", "elbow_speed", "shoulder_speed"],
        ["elbow_angle_ref", "shoulder_angle_ref", "shoulder_speed_ref", "elbow_speed_ref"],
        [{"q": ["shoulder_angle", "elbow_angle"], "qd": ["shoulder_speed", "elbow_speed"],
          "position_ref": ["shoulder_angle_ref", "elbow_angle_ref"],
          "velocity_ref": ["shoulder_speed_ref", "elbow_speed_ref"]}],
    ),
    "one input for either of two": (
        ["cart_position", "pole_angle", "cart_velocity", "pole_speed"], ["force"],
        [{"q": "cart_position", "qd": "cart_velocity", "tau": "force"},
         {"q": "pole_angle", "qd": "pole_speed", "tau": "force"}],
    ),
    "inputs that are numbered alone": (
        ["shoulder_angle", "elbow_angle", "elbow_speed", "shoulder_speed"], ["u1", "u2"],
        [{"q": [f"{j}_angle" for j in joints], "qd": [f"{j}_speed" for j in joints],
          "tau": {"pattern": "u{i}", "base": 1}} for joints in (JOINTS, JOINTS[::-1])],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_quantities_of_the_same_joints_are_proposed_in_the_same_order(tmp_path, case):
    outputs, inputs, wanted = CASES[case]
    named = chain((n, "output") for n in outputs), ((n, "input") for n in inputs)
    text = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" causality="{causality}"><Real/>'
        "</ScalarVariable>"
        for i, (name, causality) in enumerate(chain(*named))
    )
    archive = open_archive(with_variables(tmp_path / "a.fmu", 2, text))
    lines = [as_line(guess.names) for guess in proposals(archive, {})[0]]
    assert [tomllib.loads(line)["variables"] for line in lines] == wanted


LIMBS = [{"q": ["left.q", "right.q"], "qd": ["left.dq", "right.dq"], "tau": ["left.u", "right.u"]}]
ARRAYS: dict[str, tuple[str, Any]] = {
    "an array a limb": ("left.q 3 right.q 3 right.dq 3 left.dq 3 ; right.u 3 left.u 3", LIMBS),
    "limbs of two sizes": ("left.q 3 right.q 2 right.dq 2 left.dq 3 ; right.u 2 left.u 3", LIMBS),
    "an array for all inputs": (
        "shoulder.phi 1 elbow.phi 1 elbow.w 1 shoulder.w 1 ; u 2",
        [{"q": [f"{j}.phi" for j in joints], "qd": [f"{j}.w" for j in joints], "tau": "u"}
         for joints in (JOINTS, JOINTS[::-1])],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", ARRAYS)
def test_arrays_are_matched_by_joint_and_by_size(tmp_path, case):
    declared, wanted = ARRAYS[case]
    outputs, inputs = (part.split() for part in declared.split(";"))
    text = "".join(
        f'<Float64 name="{name}" valueReference="{i}" causality="{causality}">'
        f'<Dimension start="{size}"/></Float64>'
        for causality, some, first in (("output", outputs, 1), ("input", inputs, 50))
        for i, (name, size) in enumerate(zip(some[::2], some[1::2], strict=True), first)
    )
    archive = open_archive(with_variables(tmp_path / "a.fmu", 3, text))
    lines = [as_line(guess.names) for guess in proposals(archive, {})[0]]
    assert [tomllib.loads(line)["variables"] for line in lines] == wanted


Called = dict[str, tuple[str, ...]]
STATE: Called = {"q": ("shoulder_angle", "elbow_angle"), "qd": ("shoulder_speed", "elbow_speed")}
TORQUE: Called = {"tau": ("shoulder_torque", "elbow_torque")}
REFERENCE: Called = {
    "position_ref": ("shoulder_angle_ref", "elbow_angle_ref"),
    "velocity_ref": ("shoulder_speed_ref", "elbow_speed_ref"),
}
MOTORS: Called = {"tau_applied": ("shoulder_motor_angle", "elbow_motor_angle")}
BACK: Called = {ours: names[::-1] for ours, names in STATE.items()}
NUMBERED: dict[str, Any] = {"tau": {"pattern": "u{i}", "base": 1}}
TRIALS: dict[str, tuple[Called, dict[str, Any] | None]] = {
    "by joint": (STATE | TORQUE, STATE | TORQUE),
    "numbers in the joints' order": (STATE | {"tau": ("u1", "u2")}, STATE | NUMBERED),
    "numbers in another order": (STATE | {"tau": ("u2", "u1")}, BACK | NUMBERED),
    "angles that are none": (STATE | TORQUE | MOTORS, STATE | TORQUE),
    "references": (STATE | REFERENCE, STATE | REFERENCE),
    "an angle and a speed of two joints": (
        {"q": ("shoulder_angle", "z1"), "qd": ("z2", "elbow_speed"), "tau": ("motor", "z3")}, None,
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", TRIALS)
def test_of_what_may_be_right_only_what_moves_so_is_proposed(tmp_path, case):
    """The arm's description says no unit and no derivative, so that names alone tell something."""
    called, wanted = TRIALS[case]

    def name(stem: str, indices: list[int]) -> str:
        if stem in called:
            return called[stem][indices[0] - 1]
        # The gains are found by their names; what else there is, by none that says anything.
        entry = f"[{','.join(map(str, indices))}]"
        return f"{stem}{entry}" if stem in {"kp", "kd"} else f"z{stem}z{entry}"

    def edit(text: str) -> str:
        return re.sub(r' (derivative|unit)="[^"]*"', "", renamed(text, name))

    archive = open_archive(rewritten(tmp_path / "a.fmu", 2, edit))
    found = [f.text for f in findings(CheckTask(archive), Budget()) if f.name == "proposal"]
    lines = [text[text.index("variables = {") :] for text in found if "variables = {" in text]
    proposed = [tomllib.loads(line)["variables"] for line in lines]
    assert proposed == ([json.loads(json.dumps(wanted))] if wanted else [])
