"""Noise on links, and how far it keeps the estimates from what they would settle to.

Robot i receives Σ_j D_ij (σ_j + n_ij), where n_ij is drawn anew for each link, sample and number.
So x(t_{k+1}) = A x(t_k) + w(t_k) beside the target's part, with w of mean 0, independent from robot
to robot and from tick to tick, and of the covariance of robot i

    Q_i = F G diag(Σ_j D_ij² var n_ij) (F G)ᵀ.

- Where ρ < 1, the covariance of x goes to the only Σ = A Σ Aᵀ + Q (statement N1).
- Of digraphs in turn it goes to one for each tick of a period (statement N2).
- The mean of squares over N ticks has a variance of its own, which follows from Σ (statement N3).

Σ is summed by doubling: S_{2l} = S_l + A^l S_l (A^l)ᵀ, with S_1 = Q.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix, as_array
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep

Array = NDArray[np.float64]

LARGEST = 600
"""The order of A up to which Σ is computed."""
DOUBLINGS, LEFT = 64, 1e-16
"""At most so many, and the part of Σ at which the sum ends."""
LAGS, FORGOTTEN = 500, 1e-3
"""Ticks that a correlation is followed, and the correlation at which it ends."""

Ticks = Sequence[tuple[Array, Array]]
"""A and Q, both of the order of A, of each tick of a period."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseFloor:
    """What noise comes to in steady state, of each number of a robot's estimate."""

    variance: Array
    """(2, n) of positions, m² or rad², and of velocities, over the ticks of a period."""
    ticks: Ticks
    covariances: Sequence[Array]
    """Σ of each of these ticks, of left limits."""

    @property
    def deviation(self) -> Array:
        """(2, n) standard deviations of positions, m or rad, and of velocities, of each number."""
        return np.sqrt(self.variance)

    def standard_error(self, count: int, m: int) -> Array:
        """Return that of the mean of squares over `count` ticks and m axes, (2, n) (N3)."""
        summed = np.zeros(self.variance.size)
        rows = np.arange(self.variance.size)
        for start, Sigma in enumerate(self.covariances):
            lagged, variance = Sigma[:, rows], Sigma.diagonal()[rows]
            summed += variance**2
            for lag in range(1, min(count, LAGS)):
                lagged = self.ticks[(start + lag - 1) % len(self.ticks)][0] @ lagged
                along = lagged[rows, rows]
                summed += 2 * (1 - lag / count) * along**2
                if (np.abs(along) <= FORGOTTEN * variance).all():
                    break
        mean = summed / len(self.covariances)
        return np.sqrt(2 * mean / (count * m)).reshape(self.variance.shape)


def received_covariance(
    step: LinearStep, topologies: Mapping[str, Topology], variances: Mapping[str, Array]
) -> Array:
    """Return Q, (s n, s n), of noise with `variances` (E,) by field of a sample and edge.

    `topologies` are the digraphs that the fields travel over.
    """
    n, s = next(iter(topologies.values())).n, len(step.fields)
    of_robots = np.zeros((n, len(step.sent)))
    for field, name in enumerate(step.sent):
        topology = topologies[name]
        weights = topology.normalised**2 * variances[name]
        of_robots[:, field] = np.bincount(topology.sink - 1, weights, n)
    blocks = np.einsum("aq,nq,bq->abn", step.samples, of_robots, step.samples)
    Q = np.zeros((s, n, s, n))
    at = np.arange(n)
    Q[:, at, :, at] = blocks.transpose(2, 0, 1)
    return Q.reshape(s * n, s * n)


def noise_floor(period: Sequence[tuple[Matrix, Array]], n: int) -> NoiseFloor | None:
    """Return what noise comes to where ρ < 1, of A and Q of each tick of a period.

    The first n rows are positions, the next velocities. Q may be of fewer rows than A, the first.
    None where A is too large, or Σ is not finite.
    """
    order = period[0][0].shape[0]
    if order > LARGEST:
        return None
    ticks = [(as_array(A), np.pad(Q, (0, order - len(Q)))) for A, Q in period]
    M, R = np.eye(order), np.zeros((order, order))
    for A, Q in ticks:
        M, R = A @ M, A @ R @ A.T + Q
    Sigma = _summed(M, R)
    if Sigma is None:
        return None
    covariances = [Sigma]
    for A, Q in ticks[:-1]:
        covariances.append(A @ covariances[-1] @ A.T + Q)
    mean = np.mean([one.diagonal() for one in covariances], axis=0)
    return NoiseFloor(mean[: 2 * n].reshape(2, n), ticks, covariances)


def _summed(A: Array, Q: Array) -> Array | None:
    """Return Σ_l A^l Q (A^l)ᵀ; None where it does not come to an end."""
    S = Q
    for _ in range(DOUBLINGS):
        with np.errstate(over="ignore", invalid="ignore"):
            more = A @ S @ A.T
            S = S + more
            A = A @ A
        size = np.abs(S).max()
        if not np.isfinite(size):
            return None
        if np.abs(more).max() <= LEFT * size:
            return S
    return None
