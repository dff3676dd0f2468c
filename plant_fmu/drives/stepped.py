"""Plants in Co-Simulation: instances with their law at one time, stepped, read, saved, put back."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.quantities import MOTION
from nrs_cosim.plant_fmu.drives.checkpoint import decode, encode
from nrs_cosim.plant_fmu.drives.pd_law import Law
from nrs_cosim.plant_fmu.fmi.instances import Instances, NativeSteps
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.states import States
from nrs_cosim.plant_fmu.plants import Array, Body, DrivenPlants

StartValues = Callable[[Body], Mapping[str, Any]]


class Stepped:
    """Some robots' plants at one time, a row a robot; see `plant_fmu.plants.DrivenPlants`."""

    kind = "CoSimulation"
    drive = "Co-Simulation"

    def __init__(
        self,
        library: Library,
        bodies: Sequence[Body],
        names: Mapping[str, Spec],
        start_values: StartValues,
        outputs: Sequence[str],
        why: str,
    ) -> None:
        """Instantiate and initialise one plant for each body; `FmuError` says what is wrong.

        `start_values` are those of a body, by our names: what is told nothing starts where it does.
        `names` gives the FMU's name for a quantity of ours where it has another.
        """
        self.why, self._start_values = why, start_values
        m = self.m = len(bodies[0].q)
        self.outputs = np.zeros((len(bodies), len(outputs) * m))
        self.state = self.outputs[:, : 2 * m]
        """q, then qd: the first two outputs."""
        self.q, self.qd = self.state[:, :m], self.state[:, m:]
        self.tau = np.zeros((len(bodies), m))
        self.instances = Instances(library, bodies, names)
        self._told_by = [self.instances.vector(name, m) for name in outputs]
        self._read = self.instances.reads(self._told_by, self.outputs)
        self._step = self.instances.steps(self._told_by, self.outputs)
        self.checkpointable = library.saves_states
        self._states = States(self.instances) if self.checkpointable else None
        self._start(bodies)

    def start_again(self, bodies: Sequence[Body]) -> None:
        """Reset the FMUs, and initialise them with other bodies, as many, at t_0."""
        self.instances.reset()
        self._start(bodies)

    def hold(self, *reference: Array) -> None:
        """Take new references (rows, m) from now on."""
        self.law.hold(self.time, *reference)

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        self.step(start, step)
        self._tell_torque()

    def native(self) -> NativeSteps | str:
        """Return by what other native code gives them lines to follow and steps them, or why not.

        Afterwards `reached` is called.
        """
        return "their references are no inputs of the FMU"

    def reached(self, time: float) -> None:
        """Be at a time, s, to which native code stepped; next is a `hold`."""
        self.time = time

    def step(self, start: float, step: float) -> None:
        """Step all instances, and read their outputs; `StepError` where one is not finite."""
        self._step(start, step)
        self.time = start + step
        self.instances.expect_finite(self.outputs, self.time)

    def read(self) -> None:
        """Read the outputs; `StepError` where one is not finite."""
        self._read(self.time)
        self.instances.expect_finite(self.outputs, self.time)

    def save(self) -> list[bytes]:
        """Return each robot's time, law and state; only where it is `checkpointable`."""
        assert self._states is not None
        since = np.empty((len(self.state), 2))
        since[:] = self.time, self.law.since
        numbers = np.hstack([since, self.law.reference])
        return encode(self.instances.library.archive, numbers, self._states.save(self.time))

    def restore(self, data: Sequence[bytes]) -> None:
        """Put back what `save` returned; only where it is `checkpointable`."""
        assert self._states is not None
        m, instances = self.m, self.instances
        counts = [2 + 3 * m] * len(self.state)
        rows, states = decode(instances.library.archive, instances.robots, data, counts)
        numbers = np.array(rows)
        self.time = float(numbers[0, 0])
        self.law.take_up(float(numbers[0, 1]), numbers[:, 2:])
        self._states.restore(states, self.time)
        self.read()
        self._tell_torque()

    def _start(self, bodies: Sequence[Body]) -> None:
        self.law, self.time = Law(bodies), 0.0
        values = [self._start_values(body) for body in bodies]
        self.instances.initialise(bodies, values)
        self.read()
        if all(values):
            self.instances.expect_start(bodies, self.state)
        self._tell_torque()

    def _inputs(self, sizes: Mapping[str, int]) -> tuple[Array, Callable[[float], None]]:
        """Return rows (rows, numbers) for inputs of given sizes, and the act that gives them."""
        rows = np.zeros((len(self.outputs), sum(sizes.values())))
        found = [self.instances.vector(name, size) for name, size in sizes.items()]
        return rows, self.instances.writes(found, rows)

    def _tell_torque(self) -> None:
        """Bring `tau` up to this time: by the law."""
        self.tau[:] = self.law.torque(self.time, self.state)


def step_by_threads(plants: DrivenPlants, count: int) -> None:
    """Let so many threads step plants, of which FMUs must share nothing that changes."""
    if isinstance(plants, Stepped):
        plants.instances.rounds.use_threads(count)


class FreePlants(Stepped):
    """Not driven at all: an FMU that takes nothing moves by itself, as a target does.

    Its `position` and `velocity` stand for q and qd, and there is no torque.
    """

    def __init__(
        self, library: Library, bodies: Sequence[Body], names: Mapping[str, Spec], why: str
    ) -> None:
        super().__init__(library, bodies, names, lambda _: {}, MOTION, why)

    def hold(self, *reference: Array) -> None:
        """Take no reference, whatever (rows, m) is given."""

    def _tell_torque(self) -> None:
        """There is none."""
