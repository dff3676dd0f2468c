"""How large errors are in the mean square, in steady state, over links that lose samples.

With A_k = Ā + Σ ξ_e M_e, and likewise the inputs, the mean of the errors goes with Ā: for sines it
settles to μ of (e^{jωh} I − Ā) μ = B̄ u, as if all links came to their means. Around it, with what
deviates, Σ_e M_e μ + N_e u, the covariance averaged over time is that of Σ = E[A Σ Aᵀ] + Q with
Q = ½ Σ_ω Re Σ_e (M_e μ + N_e u)(M_e μ + N_e u)ᴴ (statement L6), where no two frequencies are
alike at the sampling times. A rate adds a constant μ, whose Q has no ½.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.linear_step import NEAR, LinearStep
from nrs_cosim.estimator_agents.theory.lossy_step import LossyStep, Z, squared, squares

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

DENSE = 60
"""States up to which the covariance is solved for, as a matrix times a vector."""
LEFT, MOST = 1e-12, 100_000
"""The part of a sum of more at which it ends, and its terms at most."""


@dataclass(frozen=True, slots=True, eq=False)
class SecondMoments:
    """Mean squares of errors in steady state, over time and all that may be lost: (s, n, m)."""

    mean: Array
    """Of the mean error, which is as it would be if every tick came to its mean."""
    spread: Array
    """Around it."""

    @property
    def root_mean_square(self) -> Array:
        """(s, n, m)"""
        root: Array = np.sqrt(self.mean + self.spread)
        return root


def second_moments(
    lossy: LossyStep, step: LinearStep, n: int, target: Harmonic
) -> SecondMoments | None:
    """Return them where the mean-square radius is below 1, for n robots; None if not known.

    It is not known where the target sends what no agent does, and where agents that are right do
    not stay so at a target that rests.
    """
    E, s = step.truth, len(step.fields)
    rests = [step.own + step.received] + ([] if step.alone is None else [step.alone])
    if not step.agrees or not all(np.allclose(one @ E[:, 0], E[:, 0], atol=NEAR) for one in rests):
        return None
    mean = lossy.mean
    p = len(mean)
    lags = np.arange((mean.shape[1] - p) // Z) - 1
    frequency, waves = target.phasors()
    turns = np.exp(1j * frequency * step.h)
    z = np.array([np.ones_like(frequency), 1j * frequency, -(frequency**2)]).T
    inputs = [
        np.concatenate([one * turn**-lag for lag in lags])
        for one, turn in zip(z, turns, strict=True)
    ]
    inputs.append(np.concatenate([[-lag * step.h, 1, 0] for lag in lags]).astype(complex))
    of_axis = np.concatenate([np.abs(waves) ** 2 / 2, target.rate[None] ** 2])
    means, spreads = np.zeros((p, waves.shape[1])), np.zeros((p, waves.shape[1]))
    for turn, u, power in zip([*turns, 1.0], inputs, of_axis, strict=True):
        if not power.any():
            continue
        mu = np.linalg.solve(turn * np.eye(p) - mean[:, :p], mean[:, p:] @ u)
        around = _covariance(lossy, np.concatenate([mu, u]))
        if around is None:
            return None
        means += np.abs(mu[:, None]) ** 2 * power
        spreads += around.diagonal()[:, None] * power
    shape = s, n, waves.shape[1]
    return SecondMoments(means[: s * n].reshape(shape), spreads[: s * n].reshape(shape))


def _covariance(lossy: LossyStep, mu: Complex) -> Array | None:
    """Return Σ of E[A Σ Aᵀ] + Q, with Q of what turns with μ; None where the sum takes too long."""
    mean, deviations = lossy.mean, lossy.deviations()
    p = len(mean)
    A, Q = mean[:, :p], np.zeros((p, p))
    for rows, of in deviations:
        off = of @ mu
        Q[np.ix_(rows, rows)] += np.einsum("ea,eb->ab", off, off.conj()).real
    spread = [(rows, of[:, :, :p]) for rows, of in deviations]
    if p <= DENSE:
        whole = np.linalg.solve(np.eye(p * p) - squares(A, spread), Q.ravel())
        return np.asarray(whole.reshape(p, p), np.float64)
    found, term = Q.copy(), Q
    for _ in range(MOST):
        term = squared(A, spread, term)
        found += term
        if np.abs(term).max() <= LEFT * np.abs(found).max():
            return found
    return None
