"""t_0 … t_K in integer nanoseconds, by multiplication; float seconds are only for the FMU.

    t_{jL + i} = j t_L + t_i − δ_{jL + i},   t_0 = 0

for a list t_1 … t_L that is repeated; periodic sampling is the list of one, t_1 = h. With jitter
each sampling time is early by a δ_k of its own, 0 <= δ_k < h, so that there is no drift. The output
grid divides each interval (t_{k−1}, t_k] into equal parts, as many in each, to the ns below, and
ends at t_k.
"""

from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal
from functools import lru_cache
from itertools import pairwise

from nrs_cosim.bus.random_streams import random_stream

NS_PER_S = 1_000_000_000
BLOCK = 64
"""Draws are made for so many sampling times at once."""


def nanoseconds(seconds: float) -> int:
    """Return a time of decimal digits as written in ns; `ValueError` where it is no whole number.

    0.1 is read as the decimal 0.1, not as the binary fraction next to it.
    """
    ns = Decimal(repr(seconds)) * NS_PER_S
    if ns != ns.to_integral_value():
        raise ValueError(f"{seconds!r} s is no whole number of nanoseconds")
    return int(ns)


def seconds(ns: int) -> float:
    """Return the double nearest to a time in ns."""
    return ns / NS_PER_S


@dataclass(frozen=True, slots=True)
class Jitter:
    """By how much sampling times are early: δ_k, uniform in 0 … most, keyed by seed and k."""

    seed: int
    most: int
    """ns"""

    def at(self, k: int) -> int:
        """Return δ_k, ns."""
        number, offset = divmod(k, BLOCK)
        # t_0 is where time begins: it is not early.
        return _drawn(self.seed, self.most, number)[offset] if k else 0


@lru_cache(maxsize=64)
def _drawn(seed: int, most: int, number: int) -> list[int]:
    rng = random_stream(seed, "sampling jitter", number)
    drawn: list[int] = rng.integers(0, most, BLOCK, endpoint=True).tolist()
    return drawn


@dataclass(frozen=True, slots=True)
class Clock:
    """The sampling times t_0 … t_K, and the output grid between them; all in ns."""

    times: tuple[int, ...]
    """t_1 … t_L, which are repeated."""
    parts: int
    """Of each interval."""
    ticks: int
    """K"""
    jitter: Jitter | None = None

    @property
    def cycle(self) -> int:
        """t_L: how long the list is."""
        return self.times[-1]

    @property
    def period(self) -> int | None:
        """h, where sampling is periodic."""
        return self.cycle if len(self.times) == 1 and not self.jitter else None

    @property
    def gaps(self) -> list[int]:
        """t_1 − t_0 … t_L − t_{L−1} as they are without jitter."""
        return [after - before for before, after in pairwise((0, *self.times))]

    @property
    def shortest(self) -> int:
        """No interval is shorter."""
        return min(self.gaps) - (self.jitter.most if self.jitter else 0)

    @property
    def longest(self) -> int:
        """No interval is longer."""
        return max(self.gaps) + (self.jitter.most if self.jitter else 0)

    def t(self, k: int) -> int:
        """Return t_k."""
        if len(self.times) == 1 and not self.jitter:
            return k * self.times[0]
        turns, i = divmod(k, len(self.times))
        t = turns * self.times[-1] + (self.times[i - 1] if i else 0)
        return t - self.jitter.at(k) if self.jitter else t

    def since(self, time: int) -> int:
        """Return the first k with t_k >= a time."""
        turns, rest = divmod(time, self.cycle)
        k = turns * len(self.times) + (bisect_left(self.times, rest) + 1 if rest else 0)
        # That is where the list has it; with jitter it may be too early, but never by a whole gap.
        return k if self.t(k) >= time else k + 1

    def outputs(self, k: int) -> Sequence[int]:
        """Return the output times in (t_{k−1}, t_k]; for k = 0 only t_0."""
        if not k:
            return [0]
        if self.parts == 1:
            return [self.t(k)]
        start = self.t(k - 1)
        span = self.t(k) - start
        return [start + part * span // self.parts for part in range(1, self.parts + 1)]
