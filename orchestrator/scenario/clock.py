"""t_k = t_0 + k h in integer nanoseconds, by multiplication; float seconds are only for the FMU.

The output grid divides each interval (t_{k−1}, t_k] into equal parts and ends at t_k.
"""

from dataclasses import dataclass
from decimal import Decimal

NS_PER_S = 1_000_000_000


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
class Clock:
    """The sampling times t_0 … t_K, and the output grid between them; all in ns."""

    period_ns: int
    output_ns: int
    ticks: int

    def t(self, k: int) -> int:
        """Return t_k."""
        return k * self.period_ns

    def outputs(self, k: int) -> range:
        """Return the output times in (t_{k−1}, t_k]; for k = 0 only t_0."""
        first = self.t(k - 1) + self.output_ns if k else 0
        return range(first, self.t(k) + 1, self.output_ns)
