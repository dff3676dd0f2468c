"""Chance has a name, (seed, purpose, robot or link): a draw depends on no order and no layout."""

from collections.abc import Sequence
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus import former_mathematics
from nrs_cosim.bus.mathematics import normal_quantile


def random_stream(seed: int, purpose: str, *key: int) -> np.random.Generator:
    """Return the generator of what is drawn for one purpose and robot, or link and block."""
    # crc32, for Python's own hash of a text is another in each process.
    sequence = np.random.SeedSequence([seed, crc32(purpose.encode()), *key])
    return np.random.Generator(np.random.Philox(sequence))


def keyed_uniform(
    seed: int, purpose: str, robots: NDArray[np.integer], k: int, size: int
) -> NDArray[np.float64]:
    """Return draws from [0, 1), (robots, size): 53 bits of a hash of the key and their place.

    No generator is made for any robot, which would take 20 us each. Each part of the key is mixed
    by itself before it joins the others: parts that meet by xor alone come to equal keys.
    """
    parts = (
        np.uint64(seed % 2**64),
        np.uint64(crc32(purpose.encode())),
        robots[:, None].astype(np.uint64),
        np.uint64(k),
        np.arange(size, dtype=np.uint64)[None],
    )
    z = np.zeros((1, 1), np.uint64)
    for part in parts:
        z = _mixed(z ^ _mixed(np.atleast_2d(part)))
    return (z >> np.uint64(11)).astype(np.float64) * 2.0**-53


def keyed_normal(
    seed: int, purpose: str, robots: NDArray[np.integer], k: int, size: int
) -> NDArray[np.float64]:
    """Return draws of mean 0 and variance 1, (robots, size), by the inverse of Φ."""
    return _normal(keyed_uniform(seed, purpose, robots, k, size))


def normal(rng: np.random.Generator, shape: Sequence[int]) -> NDArray[np.float64]:
    """Return draws of mean 0 and variance 1, (…): those of NumPy take a library's logarithms."""
    if former_mathematics.is_former():
        return former_mathematics.former_normal(rng, shape)
    return _normal(rng.random(shape))


def _normal(uniform: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the numbers at which Φ is so much, but for half of 2⁻⁵², and neither 0 nor 1."""
    return normal_quantile((np.floor(uniform * 2.0**52) + 0.5) * 2.0**-52)


def _mixed(z: NDArray[np.uint64]) -> NDArray[np.uint64]:
    """Return the finalizer of splitmix64, a bijection of 64 bits."""
    z = z + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))
