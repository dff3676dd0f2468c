"""x(t + h) = x + h (k1 + 2 k2 + 2 k3 + k4) / 6, the classical method of order 4, steps equal.

A step over which an event indicator changes its sign is taken back, and halved until the change
lies within a width of a few roundings.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.summation import summed
from nrs_cosim.plant_fmu.drives.exchange_instance import Exchanged
from nrs_cosim.plant_fmu.drives.grid import parts
from nrs_cosim.plant_fmu.fmi.calls import is_fine
from nrs_cosim.plant_fmu.plants import Array

WEIGHTS = np.array([1, 2, 2, 1]) / 6
WIDTH = 1e-12
"""s, or relative to t where that is more: how narrowly the time of a state event is found."""


class RungeKutta:
    """See `plant_fmu.drives.model_exchange.Solver`."""

    def __init__(self, robot: Exchanged, step: float) -> None:
        """Solve a robot's equations with steps no longer than `step` s."""
        self._robot, self._step = robot, step
        self._slopes = np.empty((4, robot.states.size))
        self._stage = np.empty(robot.states.size)
        self._slopes_at = [slope.ctypes.data for slope in self._slopes]
        self._stage_at = self._stage.ctypes.data
        self.restart()

    def restart(self) -> None:
        """Take the signs of the indicators as they are now."""
        self._positive = self._signs(self._robot.time)

    def advance(self, until: float) -> bool:
        """Move the robot up to a time or just past its first event."""
        start = self._robot.time
        count = parts(until - start, self._step)
        part = (until - start) / count
        # `any` stops at the first event; the last step ends at the very time that was asked for.
        return any(
            self._move(until if j == count else start + j * part) for j in range(1, count + 1)
        )

    def _move(self, time: float) -> bool:
        """Make one step; return whether it ended at an event."""
        robot = self._robot
        before, start = robot.states.copy(), robot.time
        self._try(before, start, time)
        crossed = self._crosses(time)
        if crossed:
            time = self._find(before, start, time)
        return robot.complete(time) or crossed

    def _find(self, before: Array, start: float, end: float) -> float:
        """Narrow down where a sign changes, and stop just after."""
        low, high = start, end
        while high - low > WIDTH * max(1.0, abs(high)):
            middle = low + (high - low) / 2
            self._try(before, start, middle)
            if self._crosses(middle):
                high = middle
            else:
                low = middle
        self._try(before, start, high)
        return high

    def _try(self, before: Array, start: float, end: float) -> None:
        """Put the robot's states where one step leads them."""
        h, k, states = end - start, self._slopes, self._robot.states
        half = start + h / 2
        self._slope(0, start, before)
        self._slope(1, half, before + h / 2 * k[0])
        self._slope(2, half, before + h / 2 * k[1])
        self._slope(3, end, before + h * k[2])
        states[:] = before + h * summed(WEIGHTS * k.T)

    def _slope(self, stage: int, time: float, states: Array) -> None:
        self._stage[:] = states
        status = self._robot.derivatives(time, self._stage_at, self._slopes_at[stage])
        if not is_fine(status):
            raise self._robot.refusal("evaluating the derivatives", status)

    def _crosses(self, time: float) -> bool:
        return bool((self._signs(time) != self._positive).any())

    def _signs(self, time: float) -> NDArray[np.bool_]:
        """Return which indicators are positive at a time and the robot's states."""
        robot = self._robot
        if robot.indicators.size:
            status = robot.signs(time, robot.states_at, robot.indicators_at)
            if not is_fine(status):
                raise robot.refusal("evaluating the event indicators", status)
        return robot.indicators > 0
