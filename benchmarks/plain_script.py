"""The paper's example as a script with NumPy and FMPy: no bus, no disk, nothing kept but the end.

    python plain_script.py SCENARIO FMU START END

START is where the arms begin, END where the script puts q and q̇ of its last time: NumPy's files.
"""

import sys
import tomllib
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi3 import FMU3Slave

START = ("kp", "kd", "disturbance_amplitude", "disturbance_frequency", "disturbance_phase")
INPUTS = ("position_ref", "velocity_ref", "reference_time")
OUTPUTS = ("q", "qd", "tau_applied")
WAVES = 8


def main(scenario: str, fmu: str, start: str, end: str) -> None:
    """Run it; see the module."""
    given = tomllib.loads(Path(scenario).read_text("utf-8"))
    run, algorithm, network = given["run"], given["algorithm"], given["network"]
    h, step = run["sampling_period"], run["output_step"]
    weight = np.column_stack([network["pinning"], network["adjacency"]]).astype(float)
    weight /= weight.sum(axis=1, keepdims=True)
    with np.load(start) as first:
        position, velocity, q, qd = (first[name] for name in ("position", "velocity", "q", "qd"))
    description, folder = read_model_description(fmu), extract(fmu)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    waves = np.zeros((3, 2, WAVES))
    for axis, terms in enumerate(given["disturbance"]["axes"]):
        waves[:, axis, 0] = wave(terms)
    gains = [(given["controller"][name] * np.eye(2)).ravel() for name in ("kp", "kd")]
    starts = dict(zip(START, [*gains, *waves.reshape(3, -1)], strict=True))
    arms = []
    for robot in range(len(q)):
        arm = FMU3Slave(
            guid=description.instantiationToken,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=f"arm {robot}",
        )
        arm.instantiate()
        for name, values in {**starts, "q": q[robot], "qd": qd[robot]}.items():
            arm.setFloat64([reference[name]], list(values))
        arm.enterInitializationMode()
        arm.exitInitializationMode()
        arms.append(arm)
    inputs, outputs = ([reference[name] for name in names] for names in (INPUTS, OUTPUTS))
    found = np.zeros((len(arms), 6))
    parts = round(h / step)
    for k in range(round(run["duration"] / h)):
        t = k * h
        for robot, arm in enumerate(arms):
            arm.setFloat64(inputs, [*position[robot], *velocity[robot], t])
        for part in range(parts):
            for robot, arm in enumerate(arms):
                arm.doStep(t + part * step, step)
                found[robot] = arm.getFloat64(outputs, nValues=6)
        position = position + h * velocity
        of_target = target(given["target"]["axes"], t + h)
        sent = (np.vstack([of_target[0], position]), np.vstack([of_target[1], velocity]))
        position = position + algorithm["alpha"] * (weight @ sent[0] - position)
        velocity = velocity + algorithm["beta"] * (weight @ sent[1] - velocity)
    np.save(end, found[:, :4])


def wave(terms: dict) -> tuple[float, float, float]:
    """Return amplitude, frequency and phase of the only wave that an axis has, as a sine."""
    if "cosines" in terms:
        return *(terms["cosines"][0][name] for name in ("amplitude", "frequency")), np.pi / 2
    return *(terms["sines"][0][name] for name in ("amplitude", "frequency")), 0.0


def target(axes: list, t: float) -> tuple[list[float], list[float]]:
    """Return the target's position and velocity at a time, s."""
    moves = [(axis["rate"], *wave(axis)) for axis in axes]
    return (
        [rate * t + a * np.sin(w * t + phase) for rate, a, w, phase in moves],
        [rate + a * w * np.cos(w * t + phase) for rate, a, w, phase in moves],
    )


if __name__ == "__main__":
    main(*sys.argv[1:])
