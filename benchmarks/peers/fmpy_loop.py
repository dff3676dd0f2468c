"""FMPy 0.3: a plain loop over its own methods, which is also what the others are held against."""

from collections.abc import Iterator
from contextlib import contextmanager
from copy import copy
from tempfile import TemporaryDirectory

from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from benchmarks.peers.work import JOINTS, OUTPUTS, H, States, Work, report, timed


@contextmanager
def opened(work: Work) -> Iterator[tuple[list[FMU2Slave], list[int], list[int]]]:
    """Load the FMU once, start all arms; with them go the references of position_ref and q, qd."""
    description = read_model_description(work.fmu)
    reference = {v.name: v.valueReference for v in description.modelVariables}
    with TemporaryDirectory() as folder:
        extract(work.fmu, unzipdir=folder)
        prototype = FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName="arm",
        )
        arms = []
        for i in range(work.n):
            arm = copy(prototype)
            arm.instantiate()
            arm.setupExperiment(startTime=0.0)
            given = work.start_values(i)
            arm.setReal([reference[name] for name in given], list(given.values()))
            arm.enterInitializationMode()
            arm.exitInitializationMode()
            arms.append(arm)
        inputs = [reference[f"position_ref[{i}]"] for i in JOINTS]
        yield arms, inputs, [reference[name] for name in OUTPUTS]


def run(work: Work, way: str = "Jacobi") -> tuple[float, States]:
    """Step all arms; values go over in one of the ways."""
    with opened(work) as (arms, inputs, outputs):
        states = [arm.getReal(outputs) for arm in arms]
        at_once = work.chain and way != "Gauss-Seidel"
        one_by_one = work.chain and way == "Gauss-Seidel"

        def step(k: int) -> States:
            if at_once and (k or way == "Jacobi"):
                for arm, before in zip(arms[1:], states[:-1], strict=True):
                    arm.setReal(inputs, before[:2])
            for i, arm in enumerate(arms):
                if one_by_one and i:
                    arm.setReal(inputs, states[i - 1][:2])
                arm.doStep(k / 10, H)
                states[i] = arm.getReal(outputs)
            return states

        return timed(work, step)


if __name__ == "__main__":
    report(run)
