"""The target moves by ε_0(t): υ_0 = ε̇_0 and a_0 = υ̇_0 are bounded (A1).

Harmonic: ε_0(t) = offset + rate t + Σ A sin(ω t + φ) on each axis. Sampled: a cubic between any two
of given times, through positions there; the spline, C², or with velocities too Hermite's, C¹.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from nrs_cosim.bus.fields import Fields
from nrs_cosim.bus.mathematics import sine, sine_and_cosine
from nrs_cosim.bus.summation import summed
from nrs_cosim.estimator_agents.cubics import Cubics, hermite, spline
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.waves import norm_supremum, supremum


class Target(Protocol):
    """How a target moves on m axes."""

    def at(self, seconds: ArrayLike) -> Estimate:
        """Return ε_0 and υ_0 at times of any shape (…): arrays (…, m)."""

    def acceleration(self, seconds: ArrayLike) -> NDArray[np.float64]:
        """Return a_0 at times of any shape (…): (…, m)."""

    def bounds(self) -> tuple[float, float]:
        """Return γ1 ≥ sup ‖υ_0‖∞ and γ2 ≥ sup ‖a_0‖∞ (A1)."""

    def norm_bounds(self) -> tuple[float, float]:
        """Return bounds on sup ‖υ_0‖₂ and sup ‖a_0‖₂."""


def sample_of(target: Target, fields: Fields, seconds: ArrayLike) -> dict[str, ArrayLike]:
    """Return what a target sends at times: of each field its truth, or else its initial value."""
    at = target.at(seconds)
    truths = {"position": at.position, "velocity": at.velocity}
    if any(field.truth == "acceleration" for field in fields.values()):
        truths["acceleration"] = target.acceleration(seconds)
    return {
        name: truths[field.truth] if field.truth else field.initial
        for name, field in fields.items()
    }


PARTS = 16
"""Of an interval between samples, that the norm of a velocity is looked for on."""


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
        sines, cosines = sine_and_cosine(angle)
        return Estimate(
            self.offset + self.rate * t + summed(self.amplitude * sines),
            self.rate + summed(self.amplitude * self.frequency * cosines),
        )

    def acceleration(self, seconds: ArrayLike) -> NDArray[np.float64]:
        """Return a_0 at times of any shape (…): (…, m)."""
        t = np.asarray(seconds, float)[..., None]
        angle = self.frequency * t[..., None] + self.phase
        pull = self.amplitude * self.frequency * self.frequency * sine(angle)
        acceleration: NDArray[np.float64] = -summed(pull)
        return acceleration

    def bounds(self) -> tuple[float, float]:
        """Return γ1 and γ2 (A1), the suprema over all times, of any axis (`waves`)."""
        return _suprema(self)

    def norm_bounds(self) -> tuple[float, float]:
        """Return bounds on sup ‖υ_0‖₂ and sup ‖a_0‖₂ over all times."""
        omega, waves = self.phasors()
        turned = omega[:, None]
        speed = norm_supremum(self.rate, omega, 1j * turned * waves)
        return speed, norm_supremum(0 * self.rate, omega, -turned * turned * waves)

    def phasors(self) -> tuple[NDArray[np.float64], NDArray[np.complex128]]:
        """Return ω ≥ 0, (w,), all different, and Â, (w, m), where ε_0 sways by Σ Im Â e^{jωt}."""
        omega, index = np.unique(np.abs(self.frequency), return_inverse=True)
        sign = np.where(self.frequency < 0, -1, 1)
        wave = sign * self.amplitude * np.exp(1j * sign * self.phase)
        total = np.zeros((len(omega), len(self.rate)), complex)
        axis = np.broadcast_to(np.arange(len(self.rate))[:, None], self.frequency.shape)
        np.add.at(total, (index.reshape(self.frequency.shape), axis), wave)
        return omega, total


@lru_cache(maxsize=16)
def _suprema(target: Harmonic) -> tuple[float, float]:
    """Return γ1 and γ2 of a target, found once however often they are asked for."""
    omega, waves = target.phasors()
    found = []
    for rate, wave in zip(target.rate.tolist(), waves.T, strict=True):
        own, of = omega[wave != 0], wave[wave != 0]
        with np.errstate(over="ignore", invalid="ignore"):  # no bound then, and so it is told
            speed, acceleration = 1j * (own * of), -(own * own) * of
        found.append((supremum(rate, own, speed), supremum(0.0, own, acceleration)))
    gamma_1, gamma_2 = np.max(found, axis=0).tolist()
    return gamma_1, gamma_2


@dataclass(frozen=True, slots=True, eq=False)
class Sampled:
    """Positions at given times and what is between them: a cubic on each interval."""

    cubics: Cubics

    @classmethod
    def of(cls, times: ArrayLike, positions: ArrayLike) -> "Sampled":
        """Return the spline through positions (s, m) at s ≥ 2 increasing times, s: C² throughout.

        At the first and at the last inner time the third derivative is continuous too (not-a-knot).
        Two samples make a line, three a parabola.
        """
        return cls(spline(np.asarray(times, float), np.asarray(positions, float)))

    @classmethod
    def through(cls, times: ArrayLike, positions: ArrayLike, velocities: ArrayLike) -> "Sampled":
        """Return the cubics of Hermite through positions and velocities, both (s, m): C¹.

        At each of the times they are what is returned, to the last bit: a piece is in powers of
        the time since its beginning, and one more, as long as a rounding, begins at the last.
        """
        t, x, v = (np.asarray(rows, float) for rows in (times, positions, velocities))
        inner = hermite(t, x, v).coefficients
        last = np.zeros_like(inner[:, :1])
        last[:2, 0] = x[-1], v[-1]
        ends = np.append(t, np.nextafter(t[-1], np.inf))
        return cls(Cubics(ends, np.concatenate([inner, last], axis=1)))

    def at(self, seconds: ArrayLike) -> Estimate:
        """Return ε_0 and υ_0 at times of any shape (…): arrays (…, m); NaN beyond the samples."""
        return Estimate(self.cubics.at(seconds), self.cubics.at(seconds, 1))

    def acceleration(self, seconds: ArrayLike) -> NDArray[np.float64]:
        """Return a_0 at times of any shape (…): (…, m); NaN beyond the samples."""
        return self.cubics.at(seconds, 2)

    def bounds(self) -> tuple[float, float]:
        """Return the suprema of |υ_0| and |a_0| of any axis over all that was sampled (A1).

        On an interval a_0 is linear and greatest at an end; υ_0 is so too, or where a_0 = 0.
        """
        _, c, b, a = self.cubics.coefficients
        length = np.diff(self.cubics.times)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            turn = -b / (3 * a)
            inside = (turn > 0) & (turn < length)
            turned = np.where(inside, (3 * a * turn + 2 * b) * turn + c, 0)
        speeds = c, (3 * a * length + 2 * b) * length + c, turned
        accelerations = 2 * b, 6 * a * length + 2 * b
        return _largest(speeds), _largest(accelerations)

    def norm_bounds(self) -> tuple[float, float]:
        """Return bounds on sup ‖υ_0‖₂ and sup ‖a_0‖₂ over all that was sampled.

        On an interval a_0 is linear, so that its norm is greatest at an end. υ_0 is a quadratic: on
        a part of length δ it is within ‖a_0′‖₂ δ²/8 of the chord, which is greatest at an end.
        """
        _, c, b, a = self.cubics.coefficients
        length = np.diff(self.cubics.times)[:, None]
        ends = 2 * b, 6 * a * length + 2 * b
        at = np.arange(PARTS + 1)[:, None, None] / PARTS * length
        speeds = np.linalg.norm((3 * a * at + 2 * b) * at + c, axis=-1).max(axis=0)
        beside = np.linalg.norm(6 * a, axis=-1) * (length[:, 0] / PARTS) ** 2 / 8
        pulls = np.linalg.norm(np.stack(ends), axis=-1)
        return float((speeds + beside).max()), float(pulls.max())


def _largest(parts: Iterable[NDArray[np.float64]]) -> float:
    return max(float(np.abs(part).max()) for part in parts)
