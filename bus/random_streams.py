"""Chance has a name, (seed, purpose, robot or link): a draw depends on no order and no layout."""

from zlib import crc32

import numpy as np


def random_stream(seed: int, purpose: str, *key: int) -> np.random.Generator:
    """Return the generator of what is drawn for one purpose and robot, or link and block."""
    sequence = np.random.SeedSequence([seed, crc32(purpose.encode()), *key])
    return np.random.Generator(np.random.Philox(sequence))
