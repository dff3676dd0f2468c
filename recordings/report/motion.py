"""The moving picture: joints and estimates at frames, evenly spread over the recording."""

from typing import Any

import numpy as np

from nrs_cosim.recordings.report.arrays import Arrays
from nrs_cosim.recordings.report.data import Story

MOST_FRAMES = 900


def motion(story: Story, arrays: Arrays) -> dict[str, Any]:
    """Return the frames of a story for the page: arrays (frames, robots, m) in single precision."""
    count = len(story.t)
    rows = np.unique(np.linspace(0, count - 1, min(count, MOST_FRAMES)).astype(np.intp))
    arms = [story.subject.arms[robot - 1] for robot in story.drawn]
    return {
        "t": arrays.put(story.t[rows]),
        "q": arrays.put(story.vectors["position"][rows].astype(np.float32)),
        "estimates": arrays.put(story.vectors["reference_position"][rows].astype(np.float32)),
        "target": arrays.put(story.target["position"][rows].astype(np.float32)),
        "lengths": [arm.lengths for arm in arms],
        "known": all(arm.known for arm in arms),
    }
