"""Not driven at all: an FMU that takes nothing moves by itself, as a target does.

Its `position` and `velocity` stand for q and qd, and there is no torque.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.quantities import MOTION
from nrs_cosim.plant_fmu.drives.stepped import Stepped
from nrs_cosim.plant_fmu.fmi.library import Library
from nrs_cosim.plant_fmu.plants import Array, Body


class FreePlants:
    """What is stepped in Co-Simulation; see `plant_fmu.plants.DrivenPlants`."""

    kind = "CoSimulation"
    drive = "Co-Simulation"

    def __init__(
        self, library: Library, bodies: Sequence[Body], names: Mapping[str, Spec], why: str
    ) -> None:
        """Instantiate and initialise one for each body; `FmuError` says what is wrong."""
        self.why, self._stepped = why, Stepped(library, bodies, names, lambda _: {}, MOTION)
        self.checkpointable = self._stepped.checkpointable
        m, state = self._stepped.m, self._stepped.state
        self.q, self.qd, self.tau = state[:, :m], state[:, m:], np.zeros((len(bodies), m))

    def hold(self, position: Array, velocity: Array) -> None:
        """Take no reference, whatever (rows, m) is given."""

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        self._stepped.step(start, step)

    def save(self) -> list[bytes]:
        """Return each one's checkpoint."""
        return self._stepped.save()

    def restore(self, data: Sequence[bytes]) -> None:
        """Put back what `save` returned."""
        self._stepped.restore(data)
