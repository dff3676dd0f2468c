"""How far a robot stays from the target (paper, Theorems 2 and 3), from P3 and A1.

With e = q − ε_0 and μ3 = λ_max(Kp) ‖ε̄‖₂ + λ_max(Kd) ‖ῡ‖₂, in the paper's notation,

    ‖φ‖₂ ≤ μ1 + μ2 ‖ė‖₂ + μ3                                                   (1.9)
    V̇ ≤ −[(λ_min(Kd) − ϱ2) ‖ė‖₂ − ϱ3] ‖ė‖₂ − [(λ_min(Kp) − ϱ1) ‖e‖₂ − ϱ3] ‖tanh e‖₂   (1.8)

with ϱ3 = μ1 + μ3. docs/theory.md derives the constants, and shows two steps of the proof that do
not follow: (1.8) holds with ‖e‖₂/√m in its last bracket, and of it alone the paper's balls δ do not
follow. What is proven is in `tracking_bounds.py`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds

Array = NDArray[np.float64]

TRACKING = "Theorems 2 and 3"
"""The source of the conditions on the gains: sufficient, and often far from necessary."""


class PlantConstants(Protocol):
    """What P3 says of a robot, in N m, kg m² and s; λ_f bounds viscous drag."""

    @property
    def lambda_m(self) -> float:
        """λ_m ≤ ‖M‖₂"""

    @property
    def lambda_M(self) -> float:  # noqa: N802, the paper's symbol
        """‖M‖₂ ≤ λ_M"""

    @property
    def lambda_c(self) -> float:
        """‖C(η, q)‖₂ ≤ λ_c ‖η‖₂"""

    @property
    def lambda_g(self) -> float:
        """‖G‖₂ ≤ λ_g"""

    @property
    def lambda_f(self) -> float:
        """‖F‖₂ ≤ λ_f"""


@dataclass(frozen=True, slots=True)
class Drive:
    """The eigenvalues of a robot's gains that the theorems speak of."""

    kp_min: float
    kp_max: float
    kd_min: float
    kd_max: float

    @classmethod
    def of(cls, kp: Array, kd: Array) -> "Drive":
        """Return them of two gains (m, m): of their symmetric parts at least, of K'K at most."""
        low = [float(np.linalg.eigvalsh((K + K.T) / 2)[0]) for K in (kp, kd)]
        high = [float(np.linalg.norm(K, 2)) for K in (kp, kd)]
        return cls(low[0], high[0], low[1], high[1])


@dataclass(frozen=True, slots=True)
class Constants:
    """μ1, μ2, ϱ1, ϱ2 of one robot and target, and what they are made of."""

    m: int
    lambda_m: float
    lambda_M: float  # noqa: N815, the paper's symbol
    mu_1: float
    """N m"""
    mu_2: float
    """N m s"""
    rho_1: float
    """N m/rad"""
    rho_2: float
    """N m s/rad"""

    def conditions(self, drive: Drive) -> list[Condition]:
        """Return the conditions of Theorems 2 and 3 on the gains."""
        least = max(2 * self.lambda_M, self.rho_1)
        return [
            Condition("kp (tracking)", TRACKING, least, drive.kp_min, at_least=True),
            Condition("kd (tracking)", TRACKING, self.rho_2, drive.kd_min, at_least=True),
        ]


def constants(
    p3: PlantConstants, m: int, lambda_d: float, gamma_1: float, gamma_2: float
) -> Constants:
    """Return the constants of inequalities (1.9) and (1.8), for m joints and ‖τ_d‖₂ ≤ λ_d."""
    speed, pull = sqrt(m) * gamma_1, sqrt(m) * gamma_2
    mu_1 = lambda_d + p3.lambda_M * pull + p3.lambda_c * (speed * speed) + p3.lambda_g
    mu_1 += p3.lambda_f * speed
    mu_2 = p3.lambda_c * speed
    rho_1 = mu_2 + p3.lambda_f / 2
    rho_2 = 2 * mu_2 + p3.lambda_M + sqrt(m) * p3.lambda_c + p3.lambda_f / 2
    return Constants(m, p3.lambda_m, p3.lambda_M, mu_1, mu_2, rho_1, rho_2)


def push(of: Constants, drive: Drive, estimates: EstimateBounds) -> float:
    """Return ϱ3 in steady state: μ1 + √m [λ_max(Kp) δ1 + λ_max(Kd) δ2], N m."""
    swing = drive.kp_max * estimates.position + drive.kd_max * estimates.velocity
    return of.mu_1 + sqrt(of.m) * swing


def balls(of: Constants, drive: Drive, estimates: EstimateBounds) -> EstimateBounds | None:
    """Return δ3 and δ4, or δ5 and δ6, as the paper states them (equations 1.7 and 5.3).

    None where its conditions on the gains do not hold.
    """
    if not all(c.holds for c in of.conditions(drive)):
        return None
    rho_3 = push(of, drive, estimates)
    return EstimateBounds(rho_3 / (drive.kp_min - of.rho_1), rho_3 / (drive.kd_min - of.rho_2))


def worst_tracking(found: Sequence[EstimateBounds | None]) -> EstimateBounds | None:
    """Return the largest over robots; None where one has none."""
    have = [pair for pair in found if pair is not None]
    if not have or len(have) < len(found):
        return None
    most = EstimateBounds(max(p.position for p in have), max(p.velocity for p in have))
    return most if most.position < inf else None
