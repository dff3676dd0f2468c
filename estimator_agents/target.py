"""The target moves as ε_0(t) = offset + rate t + Σ A sin(ω t + φ) on each axis; υ_0 = ε̇_0."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from estimator_agents.estimate import Estimate


@dataclass(frozen=True, slots=True, eq=False)
class Harmonic:
    """Sums of sines on m axes, each with up to p terms; a missing term has amplitude zero."""

    offset: NDArray[np.float64]
    """(m,)"""
    rate: NDArray[np.float64]
    """(m,) per second"""
    amplitude: NDArray[np.float64]
    """(m, p)"""
    frequency: NDArray[np.float64]
    """(m, p) rad/s"""
    phase: NDArray[np.float64]
    """(m, p) rad"""

    def at(self, seconds: ArrayLike) -> Estimate:
        """Return ε_0 and υ_0 at times of any shape (…): arrays (…, m)."""
        t = np.asarray(seconds, float)[..., None]
        angle = self.frequency * t[..., None] + self.phase
        swing = self.amplitude * np.sin(angle)
        speed = self.amplitude * self.frequency * np.cos(angle)
        return Estimate(
            self.offset + self.rate * t + swing.sum(axis=-1),
            self.rate + speed.sum(axis=-1),
        )
