"""Chance has a name, (seed, purpose, robot): a draw depends neither on order nor on layout."""

from zlib import crc32

import numpy as np


def chance(seed: int, purpose: str, robot: int) -> np.random.Generator:
    """Return the generator of what is drawn for one purpose and robot."""
    key = np.random.SeedSequence([seed, crc32(purpose.encode()), robot])
    return np.random.Generator(np.random.Philox(key))
