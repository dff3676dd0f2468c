"""The PD law is outside the FMU: its torque is held over a control step of T s.

`hold` applies tau(t), with an error of order T. `heun` steps with tau(t), goes back, and steps with
the mean of tau(t) and the tau found at t + T: an error of order T², for an FMU that can go back.
"""

from collections.abc import Mapping, Sequence

from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.drives.grid import parts
from nrs_cosim.plant_fmu.drives.stepped import Stepped
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.fmi.states import States
from nrs_cosim.plant_fmu.plants import NOTHING, Array, Body


class TorqueHeldPlants(Stepped):
    """Plants driven by `tau`; see `plant_fmu.plants.DrivenPlants`."""

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
        beside: Mapping[str, Array] = NOTHING,
    ) -> None:
        """Start them at the bodies' q and qd, and at what is given beside these, by our names."""

        def start_values(body: Body) -> dict[str, Array]:
            return {**beside, "q": body.q, "qd": body.qd}

        super().__init__(library, bodies, names, start_values, ("q", "qd"), why)
        self.drive, self._control_step = drive, control_step
        self._before = States(self.instances) if heun else None
        self._torque, self._write_torque = self._inputs({"tau": self.m})

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        count = parts(step, self._control_step)
        part = step / count
        for j in range(count):
            self._control(start + j * part, part)
        self.time = start + step
        self._tell_torque()

    def _control(self, time: float, step: float) -> None:
        torque = self._torque
        torque[:] = self.law.effort(time, self.state)
        self._write_torque(time)
        if self._before:
            self._before.take(time)
            self.step(time, step)
            torque += self.law.effort(self.time, self.state)
            torque /= 2
            self._before.put_back(time)
            self._write_torque(time)  # after going back, for an FMU's state has its inputs
        self.step(time, step)
