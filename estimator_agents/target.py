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

    @property
    def gamma_1(self) -> float:
        """The largest |υ_0| of any axis (A1): as if its sines met, which they do in the end."""
        return float(
            (np.abs(self.rate) + np.abs(self.amplitude * self.frequency).sum(axis=1)).max()
        )

    @property
    def gamma_2(self) -> float:
        """The largest |a_0| of any axis (A1), in the same way."""
        return float(np.abs(self.amplitude * self.frequency**2).sum(axis=1).max())

    def phasors(self) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return ω ≥ 0, (w,), all different, and Â, (w, m), where ε_0 sways by Σ Im Â e^{jωt}."""
        omega, index = np.unique(np.abs(self.frequency), return_inverse=True)
        sign = np.where(self.frequency < 0, -1, 1)
        wave = sign * self.amplitude * np.exp(1j * sign * self.phase)
        total = np.zeros((len(omega), len(self.rate)), complex)
        axis = np.broadcast_to(np.arange(len(self.rate))[:, None], self.frequency.shape)
        np.add.at(total, (index.reshape(self.frequency.shape), axis), wave)
        return omega, total
