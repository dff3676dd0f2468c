"""The law in the right-hand side: each robot's equations are integrated beside its FMU.

Each robot has a solver of its own, so that its motion depends on no other's. A jump of its
reference is an event, and a new beginning for the solver.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np

from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.quantities import MOTION
from nrs_cosim.plant_fmu.drives.checkpoint import decode, encode
from nrs_cosim.plant_fmu.drives.exchange_instance import Exchanged
from nrs_cosim.plant_fmu.drives.pd_law import Law
from nrs_cosim.plant_fmu.fmi.instances import Instances
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.model_calls import bind_model
from nrs_cosim.plant_fmu.fmi.states import States
from nrs_cosim.plant_fmu.plants import NOTHING, Array, Body


class Solver(Protocol):
    """A solver of one robot's dx/dt = f(t, x), see `drives.exchange_instance.Exchanged`."""

    def restart(self) -> None:
        """Forget the past: the robot's states, inputs or equations may have jumped."""

    def advance(self, until: float) -> bool:
        """Move the robot up to a time or just past its first event; return whether it has one.

        `StepError` names the time where the solver fails.
        """


STATE = ("q", "qd")
MAX_EVENTS = 10_000
"""Of one robot in one step: beyond that its events are taken to come ever closer."""


class ModelExchangePlants:
    """Plants driven by `tau` in continuous time; see `plant_fmu.plants.DrivenPlants`."""

    kind = "ModelExchange"

    def __init__(
        self,
        library: Library,
        bodies: Sequence[Body],
        names: Mapping[str, Spec],
        solve: Callable[[Exchanged], Solver],
        *,
        drive: str,
        why: str,
        free: bool = False,
        beside: Mapping[str, Array] = NOTHING,
    ) -> None:
        """Instantiate and initialise one plant for each body; `FmuError` says what is wrong.

        What is free has a `position` and a `velocity`, and is told nothing. The others start with
        what is given beside their q and qd, by our names.
        """
        self.drive, self.why, self._free = drive, why, free
        self._solve, self._beside = solve, beside
        n, m = len(bodies), len(bodies[0].q)
        self.q, self.qd, self.tau = (np.empty((n, m)) for _ in range(3))
        self._instances = Instances(library, bodies, names)
        self._calls = library.bind(bind_model)
        self.checkpointable = library.saves_states
        self._states = States(self._instances) if self.checkpointable else None
        self._start(bodies)

    @property
    def without_nominal(self) -> list[int]:
        """The numbers of the states, from 1, for which 1 stands in for a nominal value."""
        return sorted({state for robot in self._robots for state in robot.without_nominal})

    def start_again(self, bodies: Sequence[Body]) -> None:
        """Reset the FMUs, and initialise them with bodies at t_0."""
        self._instances.reset()
        self._start(bodies)

    def hold(self, *reference: Array) -> None:
        """Take new references (rows, m) from now on."""
        for row, (robot, law) in enumerate(zip(self._robots, self._laws, strict=True)):
            law.hold(robot.time, *(part[row : row + 1] for part in reference))
            robot.event()
            self._solvers[row].restart()

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        for robot, solver in zip(self._robots, self._solvers, strict=True):
            _move(robot, solver, start + step)
        self._gather()

    def save(self) -> list[bytes]:
        """Return each robot's time, next event, law and states; where it is `checkpointable`."""
        assert self._states is not None
        numbers = [
            np.hstack(
                [
                    robot.time,
                    robot.next_event,
                    law.since,
                    *law.reference[0],
                    robot.states,
                ]
            )
            for robot, law in zip(self._robots, self._laws, strict=True)
        ]
        states = self._states.save(self._robots[0].time)
        return encode(self._instances.library.archive, numbers, states)

    def restore(self, data: Sequence[bytes]) -> None:
        """Put back what `save` returned; only where it is `checkpointable`."""
        assert self._states is not None
        m, instances = self.q.shape[1], self._instances
        counts = [3 + 3 * m + robot.states.size for robot in self._robots]
        rows, own = decode(instances.library.archive, instances.robots, data, counts)
        self._states.restore(own, float(rows[0][0]))
        for numbers, robot, law, solver in zip(
            rows, self._robots, self._laws, self._solvers, strict=True
        ):
            (time, next_event, since), reference, states = np.split(numbers, [3, 3 + 3 * m])
            law.take_up(float(since), reference[None])
            robot.next_event = float(next_event)
            robot.states[:] = states
            robot.arrive(float(time))
            solver.restart()  # of its past nothing is saved: the next `hold` would end it as well
        self._gather()

    def _start(self, bodies: Sequence[Body]) -> None:
        instances, m = self._instances, self.q.shape[1]
        places = {} if self._free else {ours: instances.states_of(ours, m) for ours in STATE}
        # What is a state and cannot be told its start is set once it is initialised.
        given = [of for of in places if not places[of] or instances.takes_start(of, m)]
        values = [{**self._beside, **{of: getattr(body, of) for of in given}} for body in bodies]
        instances.initialise(bodies, values)
        self._laws = [Law([body]) for body in bodies]
        outputs = MOTION if self._free else STATE
        self._robots = [
            Exchanged(
                instances, row, self._calls, None if self._free else law, m, outputs, body.control
            )
            for row, (law, body) in enumerate(zip(self._laws, bodies, strict=True))
        ]
        where = [place for of in places for place in places[of] or [-1] * m]
        for robot, body in zip(self._robots, bodies, strict=True):
            robot.begin()
            if where:
                robot.start_at(np.hstack([body.q, body.qd]), where)
        self._solvers = [self._solve(robot) for robot in self._robots]
        self._gather()
        if not self._free:
            instances.expect_start(bodies, np.hstack([self.q, self.qd]))

    def _gather(self) -> None:
        m = self.q.shape[1]
        for row, robot in enumerate(self._robots):
            self.q[row], self.qd[row] = robot.state[0, :m], robot.state[0, m:]
            self.tau[row] = robot.torque()


def _move(robot: Exchanged, solver: Solver, end: float) -> None:
    """Move one robot to a time, through its events; one that is planned for then comes after."""
    for _ in range(MAX_EVENTS):
        if robot.time >= end:
            return
        planned = robot.next_event <= robot.time
        if planned or solver.advance(min(end, robot.next_event)):
            robot.event()
            solver.restart()
    raise robot.failure(f"more than {MAX_EVENTS} events in a step up to t = {end:g} s")
