"""Instances for Co-Simulation with their law: one time, stepped, read, saved and put back."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.drives.checkpoint import decode, encode
from nrs_cosim.plant_fmu.drives.pd_law import Law
from nrs_cosim.plant_fmu.fmi.instances import Instances
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.states import States
from nrs_cosim.plant_fmu.plants import Array, Body

StartValues = Callable[[Body], Mapping[str, Any]]


class Stepped:
    """Some robots' instances at one time, and their states (rows, …) then."""

    def __init__(
        self,
        library: Library,
        bodies: Sequence[Body],
        names: Mapping[str, Spec],
        start_values: StartValues,
        outputs: Sequence[str],
    ) -> None:
        """Instantiate and initialise; `start_values` are those of a body, by our names.

        What is told nothing starts where it does.
        """
        self._start_values = start_values
        self.m = len(bodies[0].q)
        self.outputs = np.zeros((len(bodies), len(outputs) * self.m))
        self.state = self.outputs[:, : 2 * self.m]
        """q, then qd: the first two outputs."""
        self.instances = Instances(library, bodies, names)
        told_by = [self.instances.vector(name, self.m) for name in outputs]
        self._read = self.instances.reads(told_by, self.outputs)
        self._step = self.instances.steps(told_by, self.outputs)
        self.checkpointable = library.saves_states
        self._states = States(self.instances) if self.checkpointable else None
        self._start(bodies)

    def start_again(self, bodies: Sequence[Body]) -> None:
        """Reset the FMUs, and initialise them with bodies at t_0."""
        self.instances.reset()
        self._start(bodies)

    def read(self) -> None:
        """Read the outputs; `StepError` where one is not finite."""
        self._read(self.time)
        self.instances.expect_finite(self.outputs, self.time)

    def step(self, start: float, step: float) -> None:
        """Step all instances, and read their outputs."""
        self._step(start, step)
        self.time = start + step
        self.instances.expect_finite(self.outputs, self.time)

    def inputs(self, *quantities: str) -> tuple[Array, Callable[[float], None]]:
        """Return rows (rows, numbers) for inputs of m numbers each, and the act that gives them."""
        rows = np.zeros((len(self.outputs), len(quantities) * self.m))
        found = [self.instances.vector(name, self.m) for name in quantities]
        return rows, self.instances.writes(found, rows)

    def save(self) -> list[bytes]:
        """Return each robot's time, law and state; only where it is `checkpointable`."""
        assert self._states is not None
        law, since = self.law, np.empty((len(self.state), 2))
        since[:] = self.time, self.law.since
        numbers = np.hstack([since, law.position, law.velocity])
        return encode(self.instances.library.archive, numbers, self._states.save(self.time))

    def restore(self, data: Sequence[bytes]) -> None:
        """Put back what `save` returned; only where it is `checkpointable`."""
        assert self._states is not None
        m, instances = self.m, self.instances
        numbers, states = decode(instances.library.archive, instances.robots, data, 2 + 2 * m)
        self.time = float(numbers[0, 0])
        self.law.hold(float(numbers[0, 1]), numbers[:, 2 : 2 + m], numbers[:, 2 + m :])
        self._states.restore(states, self.time)
        self.read()

    def _start(self, bodies: Sequence[Body]) -> None:
        self.law, self.time = Law(bodies), 0.0
        values = [self._start_values(body) for body in bodies]
        self.instances.initialise(bodies, values)
        self.read()
        if all(values):
            self.instances.expect_start(bodies, self.state)
