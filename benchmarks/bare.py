"""Bare stepping loops over the arms of a recording: the same references, no bus, no disk.

One uses FMPy's own methods, as its user would. The other calls the FMU's functions with fixed
types, on addresses that are known beforehand: the most that one Python process can do which makes
a call for each robot. Both end in the very states that were recorded.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from ctypes import byref, c_bool, c_char_p, c_double, c_size_t, c_uint, c_void_p
from pathlib import Path
from typing import Any

import numpy as np
from fmpy.fmi3 import FMU3Slave

from benchmarks.memory import now
from benchmarks.work import AMPLITUDE, FREQUENCY, KD, KP, H, Motion
from nrs_cosim.plant_fmu.archives.archive import find_archive, unpacked

INPUTS = ("position_ref", "velocity_ref", "reference_time")
OUTPUTS = ("q", "qd", "tau_applied")


def as_json(state: np.ndarray, reference: np.ndarray) -> dict[str, list[float]]:
    """Return what an arm is told before it starts."""
    first = [0.0] * 15  # of two joints, up to eight waves each, all but one at rest
    return {
        "kp": [KP, 0.0, 0.0, KP],
        "kd": [KD, 0.0, 0.0, KD],
        "disturbance_amplitude": [AMPLITUDE, *first],
        "disturbance_frequency": [FREQUENCY, *first],
        "q": state[:2].tolist(),
        "qd": state[2:].tolist(),
        "position_ref": reference[:2].tolist(),
        "velocity_ref": reference[2:4].tolist(),
        "reference_time": [0.0],
    }


def inputs_of(motion: Motion) -> np.ndarray:
    """Return what the arms are given at each tick, (ticks, arms, 5): the time of theirs is last."""
    ticks, n, _ = motion.references.shape
    # Where an arm's last step has led it: the time at which it began, and the step.
    times = [0.0, *(k / 10 + H for k in range(ticks - 1))]
    given = np.broadcast_to(np.array(times)[:, None, None], (ticks, n, 1))
    return np.concatenate([motion.references, given], axis=2)


@contextmanager
def loaded() -> Iterator[tuple[FMU3Slave, dict[str, int]]]:
    """Load the arm once, as FMPy does; with it go the value references by name."""
    archive = find_archive("two_link_arm", Path())
    by_name = {v.name: v.valueReference for v in archive.description.modelVariables}
    with unpacked(archive) as folder:
        arm = FMU3Slave(
            guid=archive.description.instantiationToken,
            unzipDirectory=str(folder),
            modelIdentifier=archive.name,
            instanceName="arm",
        )
        yield arm, by_name


def start(arm: FMU3Slave, by_name: dict[str, int], as_json: dict[str, list[float]]) -> None:
    """Initialise an instance with what it is told."""
    for name, values in as_json.items():
        arm.setFloat64([by_name[name]], values)
    arm.enterInitializationMode()
    arm.exitInitializationMode()


def fmpys(motion: Motion) -> dict[str, float]:
    """Step all arms by FMPy's own methods; return seconds, of the wall and of the processor."""
    n, given = len(motion.start), inputs_of(motion).tolist()
    with loaded() as (prototype, by_name):
        arms = []
        for row in range(n):
            arm = copy(prototype)  # to load it again for each takes milliseconds
            arm.instantiate()
            start(arm, by_name, as_json(motion.start[row], motion.references[0, row]))
            arms.append(arm)
        inputs, outputs = ([by_name[name] for name in names] for names in (INPUTS, OUTPUTS))
        with_state = [[0.0] * 6] * n

        def ticks() -> None:
            for k, references in enumerate(given):
                t = k / 10  # s, as k × 100 ms are rounded
                for row, arm in enumerate(arms):
                    arm.setFloat64(inputs, references[row])
                    arm.doStep(t, H)
                    with_state[row] = arm.getFloat64(outputs, nValues=6)

        spent = timed(ticks)
        motion.expect([values[:4] for values in with_state])
    return spent


def prebound(motion: Motion, begin: Callable[[], object] = int) -> dict[str, float]:
    """Step all arms by the FMU's functions; return seconds, and the bytes of an instance.

    The loop begins when `begin` returns.
    """
    n = len(motion.start)
    with loaded() as (prototype, by_name):
        dll: Any = prototype.dll
        create = dll.fmi3InstantiateCoSimulation
        create.restype = c_void_p
        create.argtypes = [c_char_p] * 3 + [c_bool] * 4 + [c_void_p, c_size_t] + [c_void_p] * 3
        token = prototype.guid.encode()
        flags = False, False, False, False
        before = now()
        handles = [create(b"arm", token, None, *flags, None, 0, *[None] * 3) for _ in range(n)]
        of_an_instance = (now() - before) / n
        for row, handle in enumerate(handles):
            arm = copy(prototype)
            arm.component = handle
            start(arm, by_name, as_json(motion.start[row], motion.references[0, row]))
        values, states = np.zeros((n, 5)), np.zeros((n, 6))
        into = [values.ctypes.data + row * values.strides[0] for row in range(n)]
        out_of = [states.ctypes.data + row * states.strides[0] for row in range(n)]
        inputs, outputs = (
            (c_uint * len(names))(*[by_name[name] for name in names]) for names in (INPUTS, OUTPUTS)
        )
        numbers = [c_void_p, c_void_p, c_size_t, c_void_p, c_size_t]
        dll.fmi3SetFloat64.argtypes = dll.fmi3GetFloat64.argtypes = numbers
        dll.fmi3DoStep.argtypes = [c_void_p, c_double, c_double, c_bool] + [c_void_p] * 4
        set_, get, step = dll.fmi3SetFloat64, dll.fmi3GetFloat64, dll.fmi3DoStep
        ends = [byref(kind()) for kind in (c_bool, c_bool, c_bool, c_double)]
        rows = list(zip(handles, into, out_of, strict=True))

        def ticks() -> None:
            for k, references in enumerate(inputs_of(motion)):
                t = k / 10  # s, as k × 100 ms are rounded
                values[:] = references
                for handle, given, found in rows:
                    set_(handle, inputs, 3, given, 5)
                    step(handle, t, H, True, *ends)
                    get(handle, outputs, 3, found, 6)

        begin()
        spent = timed(ticks)
        motion.expect(states[:, :4])
        dll.fmi3FreeInstance.argtypes, dll.fmi3FreeInstance.restype = [c_void_p], None
        for handle in handles:
            dll.fmi3FreeInstance(handle)
    return {**spent, "instance_bytes": of_an_instance}


def timed(work: Callable[[], object]) -> dict[str, float]:
    """Return the seconds that it takes, of the wall and of the processor."""
    wall, processor = time.perf_counter(), time.process_time()
    work()
    return {"seconds": time.perf_counter() - wall, "cpu": time.process_time() - processor}
