"""Instances for Co-Simulation with their law: one time, stepped, read, saved and put back."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from plant_fmu.archives.naming import Spec
from plant_fmu.drives.checkpoint import doubles, join, numbers, split
from plant_fmu.drives.law import Law
from plant_fmu.fmi.calls import bind_step
from plant_fmu.fmi.instances import Instances
from plant_fmu.fmi.library import Library
from plant_fmu.fmi.states import States
from plant_fmu.plants import Array, Body

Told = Callable[[Body], Mapping[str, Any]]


class Stepped:
    """Some robots' instances at one time, and their states (rows, …) then."""

    def __init__(
        self,
        library: Library,
        bodies: Sequence[Body],
        names: Mapping[str, Spec],
        told: Told,
        outputs: Sequence[str],
    ) -> None:
        """Instantiate and initialise; `told` says what an FMU is told of a body, by our names."""
        self._told = told
        self.m = len(bodies[0].q)
        self.outputs = np.zeros((len(bodies), len(outputs) * self.m))
        self.state = self.outputs[:, : 2 * self.m]
        """q, then qd: the first two outputs."""
        self.instances = Instances(library, bodies, names)
        self._read = self.instances.reads(
            [self.instances.vector(name, self.m) for name in outputs], self.outputs
        )
        self._step = library.bind(bind_step)
        self.exact = bool(library.interface.canSerializeFMUstate)
        self._states = States(self.instances) if self.exact else None
        self._start(bodies, 0.0)

    def start_again(self, bodies: Sequence[Body], time: float = 0.0) -> None:
        """Reset the FMUs, and initialise them with bodies at a time in s."""
        self.instances.reset()
        self._start(bodies, time)

    def read(self) -> None:
        """Read the outputs; `StepError` where one is not finite."""
        self._read(self.time)
        self.instances.expect_finite(self.outputs, self.time)

    def step(self, start: float, step: float) -> None:
        """Step all instances, and read their outputs."""
        do_step = self._step.step
        statuses = [do_step(handle, start, step) for handle in self.instances.handles]
        self.instances.expect(statuses, f"a step of {step:g} s", start)
        self.time = start + step
        self.read()

    def inputs(self, *quantities: str) -> tuple[Array, Callable[[float], None]]:
        """Return rows for inputs of m numbers each, and the act that gives them to the FMUs."""
        rows = np.zeros((len(self.outputs), len(quantities) * self.m))
        found = [self.instances.vector(name, self.m) for name in quantities]
        return rows, self.instances.writes(found, rows)

    def save(self) -> bytes:
        """Return time, law and states; without states of their own, the FMUs' q and qd."""
        law = self.law
        told = doubles(self.time, law.since, law.position, law.velocity)
        if self._states:
            return join([told, *self._states.save(self.time)])
        return join([told, *map(doubles, self.state)])

    def restore(self, data: bytes) -> None:
        """Put back what `save` returned."""
        n, m = len(self._bodies), self.m
        first, *rows = split(data, 1 + n)
        (time, since), held = np.split(numbers(first, 2 + 2 * n * m), [2])
        position, velocity = held.reshape(2, n, m)
        self.time = float(time)
        self.law.hold(float(since), position, velocity)
        if self._states:
            self._states.restore(rows, self.time)
            self.read()
        else:
            state = np.array([numbers(row, 2 * m) for row in rows])
            self.start_again(self._moved(state), self.time)
            self.law.hold(float(since), position, velocity)

    def _start(self, bodies: Sequence[Body], time: float) -> None:
        self._bodies, self.law, self.time = list(bodies), Law(bodies), time
        self.instances.initialise(bodies, [self._told(body) for body in bodies], time)
        self.read()
        self.instances.expect_start(bodies, self.state)

    def _moved(self, state: Array) -> list[Body]:
        """Return the bodies at other q and qd, with the references that they have by now."""
        m, position = self.m, self.law.position_at(self.time)
        return [
            replace(
                body,
                q=state[row, :m],
                qd=state[row, m:],
                position=position[row],
                velocity=self.law.velocity[row],
            )
            for row, body in enumerate(self._bodies)
        ]
