"""Plants of several archives advance as one: each archive's robots are a group of rows."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.drives.checkpoint import time_of
from nrs_cosim.plant_fmu.drives.stepped import Stepped
from nrs_cosim.plant_fmu.fmi.instances import NativeSteps
from nrs_cosim.plant_fmu.plants import Array, DrivenPlants


class Fleet:
    """All plants of a worker; see `plant_fmu.plants.Plants` and `Checkpointed`."""

    def __init__(self, groups: Sequence[tuple[NDArray[np.intp], DrivenPlants]], m: int) -> None:
        """Join groups, each with the rows (r,), ascending, that its plants have in the fleet."""
        rows = sum(len(rows) for rows, _ in groups)
        self._groups = [(as_slice(rows), plants) for rows, plants in groups]
        self._rows = [rows.tolist() for rows, _ in groups]
        self.plants = [plants for _, plants in groups]
        """Of each group."""
        self.checkpointable = all(plants.checkpointable for plants in self.plants)
        self.q, self.qd, self.tau = (np.empty((rows, m)) for _ in range(3))
        self._gather()

    def hold(self, *reference: Array) -> None:
        """Take new references (rows, m) from now on."""
        for rows, plants in self._groups:
            plants.hold(*(part[rows] for part in reference))

    def advance(self, start: float, step: float) -> None:
        """Advance from a time by a step, in s."""
        for plants in self.plants:
            plants.advance(start, step)
        self._gather()

    def native(self) -> list[tuple[NDArray[np.intp], NativeSteps]] | str:
        """Return the rows of each group, and by what native code steps them; or why it cannot.

        It is to fill `q`, `qd` and `tau` too, and then to say what was `reached`.
        """
        found = []
        for rows, plants in zip(self._rows, self.plants, strict=True):
            steps = plants.native() if isinstance(plants, Stepped) else "they are not stepped here"
            if isinstance(steps, str):
                return steps
            found.append((np.array(rows), steps))
        return found

    @property
    def time(self) -> float:
        """s, of plants that native code steps."""
        first = self.plants[0]
        assert isinstance(first, Stepped)
        return first.time

    def reached(self, time: float) -> None:
        """Be at a time, s, to which native code stepped; next is a `hold`."""
        for plants in self.plants:
            assert isinstance(plants, Stepped)
            plants.reached(time)

    def save(self) -> list[bytes]:
        """Return each robot's checkpoint."""
        saved = {
            row: data
            for rows, plants in zip(self._rows, self.plants, strict=True)
            for row, data in zip(rows, plants.save(), strict=True)
        }
        return [saved[row] for row in range(len(saved))]

    def restore(self, data: Sequence[bytes]) -> None:
        """Put each robot back to a checkpoint."""
        # That all are of one time is to hold across groups, which see their own alone.
        time_of(data, len(self.q))
        for rows, plants in zip(self._rows, self.plants, strict=True):
            plants.restore([data[row] for row in rows])
        self._gather()

    def _gather(self) -> None:
        for rows, plants in self._groups:
            self.q[rows], self.qd[rows], self.tau[rows] = plants.q, plants.qd, plants.tau


def as_slice(rows: NDArray[np.integer]) -> slice | NDArray[np.integer]:
    """Return ascending rows, (r,), as a slice, which numpy takes faster, where none is left out."""
    whole = bool(rows.size) and int(rows[-1]) - int(rows[0]) == rows.size - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if whole else rows
