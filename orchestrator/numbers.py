"""Robots' numbers as people write them: `1-3, 7`."""

from collections.abc import Sequence

import numpy as np


def spans(numbers: Sequence[int]) -> str:
    """Return ascending numbers as `1-3, 7`."""
    array = np.asarray(numbers)
    runs = np.split(array, np.flatnonzero(np.diff(array) != 1) + 1)
    return ", ".join(f"{run[0]}-{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def named(numbers: Sequence[int]) -> str:
    """Return `robot 7` or `robots 1-3, 7`."""
    return f"robot{'s' * (len(numbers) > 1)} {spans(numbers)}"
