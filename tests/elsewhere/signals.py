"""An engine drives one of our FMUs by signals: inputs that are set at each step, or once.

    python signals.py ENGINE FILE.fmu < task.json

The task has starts, signals as a row of inputs for each step, the step in s and the outputs; what
they come to is printed as JSON. As `engines`, it needs the engine alone, and runs in a process of
its own: engines keep libraries loaded, and print.
"""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

Numbers = Mapping[str, float]
Signals = Sequence[Numbers]
Engine = Callable[[str, Numbers, Signals, float, Sequence[str]], Sequence[float]]


def ecos(
    fmu: str, starts: Numbers, signals: Signals, step: float, outputs: Sequence[str]
) -> Sequence[float]:
    """Drive it by ecos, which knows variables by name."""
    from ctypes import CDLL, RTLD_GLOBAL  # noqa: PLC0415

    CDLL(str(Path(sys.prefix, "lib", "libtbb.so.12")), RTLD_GLOBAL)  # not found by itself
    from ecospy import EcosSimulation, EcosSimulationStructure  # noqa: PLC0415

    structure = EcosSimulationStructure()
    structure.add_model("a", fmu)
    structure.add_parameter_set("start", {f"a::{name}": value for name, value in starts.items()})
    simulation = EcosSimulation(step, structure=structure)
    simulation.init(parameter_set="start")
    for inputs in signals:
        for name, value in inputs.items():
            simulation.set_real(f"a::{name}", value)
        simulation.step()
    return [simulation.get_real(f"a::{name}") for name in outputs]


def libcosim(
    fmu: str, starts: Numbers, signals: Signals, step: float, outputs: Sequence[str]
) -> Sequence[float]:
    """Drive it by libcosim, whose manipulator overrides inputs."""
    from libcosimpy.CosimExecution import CosimExecution  # noqa: PLC0415
    from libcosimpy.CosimManipulator import CosimManipulator  # noqa: PLC0415
    from libcosimpy.CosimObserver import CosimObserver  # noqa: PLC0415
    from libcosimpy.CosimSlave import CosimLocalSlave  # noqa: PLC0415

    execution = CosimExecution.from_step_size(step_size=round(step * 1e9))
    slave = execution.add_local_slave(CosimLocalSlave(fmu, "a"))
    reference = {v.name.decode(): v.reference for v in execution.slave_variables(slave)}
    for name, value in starts.items():
        execution.real_initial_value(slave, reference[name], value)
    observer, manipulator = CosimObserver.create_last_value(), CosimManipulator.create_override()
    execution.add_observer(observer)
    execution.add_manipulator(manipulator)
    for inputs in signals:
        if inputs:
            given = [reference[name] for name in inputs]
            manipulator.slave_real_values(slave, given, [*inputs.values()])
        if not execution.step():
            raise RuntimeError("a step failed")
    found: Any = observer.last_real_values(slave, [reference[name] for name in outputs])
    return [*found]


ENGINES: dict[str, Engine] = {"ecos": ecos, "libcosim": libcosim}

if __name__ == "__main__":
    found = ENGINES[sys.argv[1]](sys.argv[2], **json.load(sys.stdin))
    print(f"\n{json.dumps(found)}")
