"""The frames of all joints that move, of all robots at all times at once: what viewers are sent."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.robots.kinematics import FRAME, Kinematics
from nrs_cosim.recordings.robots.placed import PlacedRobot

Array = NDArray[np.float64]


class MovingFrames:
    """The frames of some robots, which are among those that positions are of."""

    def __init__(self, placed: Sequence[PlacedRobot], robots: Sequence[int]) -> None:
        self.robots = len(robots)
        """Whose positions there are at a time."""
        self.names = [frame for robot in placed for frame in robot.moving]
        """Parent and child of each."""
        column = {robot: at for at, robot in enumerate(robots)}
        begins = np.cumsum([0, *(len(robot.moving) for robot in placed)]).tolist()
        self._alike: dict[Kinematics, list[tuple[int, int]]] = {}
        """Of robots of the same kinematics the columns of their positions and of their frames."""
        for robot, begin in zip(placed, begins, strict=False):
            self._alike.setdefault(robot.kinematics, []).append((column[robot.number], begin))

    def at(self, q: Array) -> Array:
        """Return (times, frames, 7) of positions (times · robots, m), a time after the other."""
        by_time = q.reshape(-1, self.robots, q.shape[1])
        found = np.empty((len(by_time), len(self.names), FRAME))
        for kinematics, places in self._alike.items():
            columns, begins = np.array(places).T
            mine = kinematics.joints(by_time[:, columns].reshape(-1, q.shape[1]))
            mine = mine[:, kinematics.moving].reshape(len(by_time), len(columns), -1, FRAME)
            found[:, begins[:, np.newaxis] + np.arange(mine.shape[2])] = mine
        return found
