"""The arm as CasADi exports it: FMI 3.0, Model Exchange, torque-driven, scalars q1, q2, …

Run as `python casadi_arm.py FOLDER`; it writes CasadiArm.fmu there.
"""

import os
import sys
from pathlib import Path

import casadi
import fmpy

M1, M2, R1, R2, J1, J2, G = 0.5, 1.5, 1.0, 0.8, 5.0, 5.0, 9.8


def export(folder: str) -> str:
    """Write the FMU into a folder and return its path."""
    os.chdir(folder)
    arm = casadi.DaeBuilder("CasadiArm")
    t1, t2 = arm.add("tau1", "input"), arm.add("tau2", "input")
    q1, q2, d1, d2 = (
        arm.add(name, "output", {"start": 0.0, "initial": "exact"})
        for name in ("q1", "q2", "qd1", "qd2")
    )
    cos, sin = casadi.cos, casadi.sin
    m11 = (M1 + M2) * R1**2 + M2 * R2**2 + 2 * M2 * R1 * R2 * cos(q2) + J1
    m12 = M2 * R2**2 + M2 * R1 * R2 * cos(q2)
    m22 = M2 * R2**2 + J2
    b = M2 * R1 * R2 * sin(q2)
    far = M2 * G * R2 * cos(q1 + q2)
    f1 = t1 + b * d2 * d1 + b * (d1 + d2) * d2 - (M1 + M2) * G * R1 * cos(q1) - far
    f2 = t2 - b * d1 * d1 - far
    det = m11 * m22 - m12 * m12
    arm.eq(arm.der(q1), d1)
    arm.eq(arm.der(q2), d2)
    arm.eq(arm.der(d1), (m22 * f1 - m12 * f2) / det)
    arm.eq(arm.der(d2), (m11 * f2 - m12 * f1) / det)
    files = arm.export_fmu({"no_warning": True})
    headers = Path(fmpy.__file__).parent / "c-code"
    files = arm.compile_fmu(files, {"include_dirs": [str(headers)]})
    return arm.pack_fmu(files, {})


if __name__ == "__main__":
    print(export(sys.argv[1]))
