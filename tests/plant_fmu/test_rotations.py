"""Rotations in plain arithmetic beside SciPy's, and nothing else on the way to a URDF's C."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from nrs_cosim.plant_fmu.bundled.rotations import (
    angle_of,
    length,
    multiplied,
    rotation,
    rotation_of,
    rpy_of,
)
from tests.cases import ALL

BUNDLED = Path(__file__).parents[2] / "plant_fmu" / "bundled"
RANDOM = np.random.default_rng(3)
ULP = np.finfo(float).eps


def test_rotations_and_products_are_scipys_and_numpys_but_for_rounding():
    for _ in range(200):
        vector, rpy = RANDOM.normal(size=3) * 10 ** RANDOM.uniform(-8, 1), RANDOM.uniform(-4, 4, 3)
        one, other = rotation(vector), rotation_of(rpy)
        np.testing.assert_allclose(one, Rotation.from_rotvec(vector).as_matrix(), atol=8 * ULP)
        np.testing.assert_allclose(other, Rotation.from_euler("xyz", rpy).as_matrix(), atol=8 * ULP)
        np.testing.assert_allclose(multiplied(one, other), one @ other, atol=4 * ULP)
        np.testing.assert_allclose(
            multiplied(one, vector), one @ vector, atol=4 * ULP * length(vector)
        )
        np.testing.assert_allclose(rotation_of(rpy_of(one)), one, atol=16 * ULP)
    assert (rotation(np.zeros(3)) == np.eye(3)).all()


QUARTERS = [k * np.pi / 2 for k in range(-2, 3)]


@pytest.mark.parametrize("pitch", QUARTERS)
def test_the_angles_of_a_pitch_of_a_quarter_turn_give_it_again(pitch):
    for roll in QUARTERS:
        R = rotation_of((roll, pitch, 0.7))
        np.testing.assert_allclose(rotation_of(rpy_of(R)), R, atol=8 * ULP)


def test_angles_are_numpys_but_for_rounding():
    y, x = RANDOM.normal(size=(2, 500)) * 10.0 ** RANDOM.integers(-9, 9, (2, 500))
    found = np.array([angle_of(*point) for point in zip(y, x, strict=True)])
    np.testing.assert_allclose(found, np.arctan2(y, x), rtol=2 * ULP)
    for y0, x0 in [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0), (-0.0, -1.0), (0.0, 0.0)]:
        assert angle_of(y0, x0) == np.arctan2(y0, x0)


@pytest.mark.parametrize(
    "module", ["rotations", "urdf_bodies", "urdf_robot", "urdf_couplings", "urdf_selection"]
)
def test_no_library_sums_or_turns_what_a_urdfs_equations_are_made_of(module):
    text = (BUNDLED / f"{module}.py").read_text("utf-8")
    tree = list(ast.walk(ast.parse(text)))
    assert not [node for node in tree if isinstance(node, ast.MatMult)]
    called = {node.attr for node in tree if isinstance(node, ast.Attribute)}
    assert not called & {"linalg", "dot", "matmul", "einsum", "inner", "vdot", "tensordot"}
    assert "scipy" not in text


ODD = """
<robot name="odd"><link name="base"/>
  <link name="a"><inertial><origin xyz="0.1 0.2 0.3" rpy="0.3 0.7 1.1"/><mass value="1.3"/>
    <inertia ixx="0.11" ixy="0.013" ixz="0.007" iyy="0.12" iyz="0.003" izz="0.09"/></inertial>
  </link>
  <link name="b"><inertial><origin xyz="-0.17 0.23 0.31" rpy="1.3 -0.7 0.1"/><mass value="2.7"/>
    <inertia ixx="0.21" ixy="0.013" ixz="0.007" iyy="0.22" iyz="0.003" izz="0.19"/></inertial>
  </link>
  <joint name="one" type="continuous"><parent link="base"/><child link="a"/>
    <origin xyz="0.3 0.1 0.77" rpy="0.1 0.2 0.3"/><axis xyz="1 2 3"/></joint>
  <joint name="two" type="continuous"><parent link="a"/><child link="b"/>
    <origin xyz="0.3 0.1 0.37" rpy="0.1 1.2 0.3"/><axis xyz="3 2 1"/></joint></robot>
"""
"""A robot of which no number is round."""
CODE = """
import sys
from pathlib import Path
from nrs_cosim.plant_fmu.bundled.rigid_body import accelerations, c_code
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
robot = read_urdf(Path(sys.argv[1]))
print(c_code(accelerations(robot, (0.0, 0.0, -9.80665))))
"""


@pytest.mark.skipif(not ALL, reason="two processes each: in make test-all")
@pytest.mark.parametrize("kernel", ["Prescott", "Nehalem", "Sandybridge"])
def test_the_c_of_a_urdf_is_the_same_whichever_processor_blas_takes_this_for(tmp_path, kernel):
    pytest.importorskip("casadi")
    (tmp_path / "odd.urdf").write_text(ODD)
    made = []
    for of in (kernel, "Haswell"):
        environment = {**os.environ, "OPENBLAS_CORETYPE": of}
        command = [sys.executable, "-c", CODE, str(tmp_path / "odd.urdf")]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        made.append(done.stdout)
    assert made[0] == made[1]
