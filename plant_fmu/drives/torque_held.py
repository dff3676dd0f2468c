"""The PD law is outside the FMU: its torque is held over a control step of T s.

`hold` applies tau(t), with an error of order T. `heun` steps with tau(t), goes back, and steps with
the mean of tau(t) and the tau found at t + T: an error of order T², for an FMU that can go back.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.drives.grid import parts
from nrs_cosim.plant_fmu.drives.stepped import Stepped
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.states import States
from nrs_cosim.plant_fmu.plants import Array, Body


class TorqueHeldPlants:
    """Plants driven by `tau`; see `plant_fmu.plants.DrivenPlants`."""

    kind = "CoSimulation"

    def __init__(
        self,
        library: Library,
        bodies: Sequence[Body],
        names: Mapping[str, Spec],
        control_step: float,
        *,
        heun: bool,
        drive: str = "",
        why: str = "",
    ) -> None:
        """Instantiate and initialise one plant for each body; `FmuError` says what is wrong."""
        self.drive, self.why, self._control_step = drive, why, control_step
        self._stepped = Stepped(library, bodies, names, _start_values, ("q", "qd"))
        self._states = States(self._stepped.instances) if heun else None
        self.checkpointable = self._stepped.checkpointable
        m, state = self._stepped.m, self._stepped.state
        self.q, self.qd, self.tau = state[:, :m], state[:, m:], np.empty((len(bodies), m))
        self._torque, self._write_torque = self._stepped.inputs("tau")
        self._tell_torque()

    def hold(self, position: Array, velocity: Array) -> None:
        """Take new references (rows, m) from now on."""
        self._stepped.law.hold(self._stepped.time, position, velocity)

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        count = parts(step, self._control_step)
        part = step / count
        for j in range(count):
            self._control(start + j * part, part)
        self._stepped.time = start + step
        self._tell_torque()

    def start_again(self, bodies: Sequence[Body]) -> None:
        """Return to t_0 with other bodies, as many."""
        self._stepped.start_again(bodies)
        self._tell_torque()

    def save(self) -> list[bytes]:
        """Return each robot's checkpoint."""
        return self._stepped.save()

    def restore(self, data: Sequence[bytes]) -> None:
        """Put back what `save` returned."""
        self._stepped.restore(data)
        self._tell_torque()

    def _control(self, time: float, step: float) -> None:
        stepped, torque = self._stepped, self._torque
        torque[:] = stepped.law.effort(time, stepped.state)
        self._write_torque(time)
        if self._states:
            self._states.take(time)
            stepped.step(time, step)
            torque += stepped.law.effort(stepped.time, stepped.state)
            torque /= 2
            self._states.put_back(time)
            self._write_torque(time)  # after going back, for an FMU's state has its inputs
        stepped.step(time, step)

    def _tell_torque(self) -> None:
        stepped = self._stepped
        self.tau[:] = stepped.law.torque(stepped.time, stepped.state)


def _start_values(body: Body) -> dict[str, Array]:
    return {"q": body.q, "qd": body.qd}
