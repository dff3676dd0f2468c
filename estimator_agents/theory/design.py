"""Inequalities (6.1) and (6.2) the other way: gains and a period that give a wanted accuracy.

For some 0 < ϵ < 1, the share of the error that stays when the estimates are exact,

    λ_min(Kp) ≥ max(2 λ_M, μ1/(ϵ δ) + ϱ1),   λ_min(Kd) ≥ μ1/(ϵ δ') + ϱ2,
    h [κ1 λ_max(Kp) + min(κ1, κ2) λ_max(Kd)] ≤ μ1 (1 − ϵ)/(ϵ √m),

with κ3 for both κ in (6.2). The gains are the least, as multiples of I. The κ depend on h through A
and its norm, which the paper passes over: h is found between a period that is small enough and one
that is not, and the inequality is checked with the very κ of the h that is returned.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from math import sqrt

from estimator_agents.theory.estimates import Pair
from estimator_agents.theory.tracking import Constants, Drive

SHORTEST, LONGEST, HALVINGS = 1e-9, 1e3, 24
"""s, s; and how often the logarithm of h is halved between them."""
MARGIN = 1e-9
"""By which the gains are above their least, for Theorems 2 and 3 want them greater."""

BoundOf = Callable[[float], Pair | None]
"""Returns δ1 and δ2 for a period in s; None where the estimates do not converge."""


@dataclass(frozen=True, slots=True)
class Design:
    """The gains and the period that promise an accuracy."""

    epsilon: float
    kp: float
    """N m/rad, times I"""
    kd: float
    """N m s/rad, times I"""
    period: float | None
    """s; None where no period is small enough for the paper's bounds."""
    sharp_period: float | None
    """s; the same with sharp bounds on the estimates."""


def design(
    robots: Sequence[Constants],
    wanted: Pair,
    epsilon: float,
    paper: BoundOf,
    sharp: BoundOf,
) -> Design:
    """Return the least gains and the largest period for δ of e (rad) and of ė (rad/s)."""
    kp = max(
        max(2 * of.lambda_M, of.mu_1 / (epsilon * wanted.position) + of.rho_1) for of in robots
    )
    kd = max(of.mu_1 / (epsilon * wanted.velocity) + of.rho_2 for of in robots)
    kp, kd = kp * (1 + MARGIN), kd * (1 + MARGIN)
    drive = Drive(kp, kp, kd, kd)
    periods = [_largest(robots, drive, epsilon, bound_of) for bound_of in (paper, sharp)]
    return Design(epsilon, kp, kd, *periods)


def _largest(
    robots: Sequence[Constants], drive: Drive, epsilon: float, bound_of: BoundOf
) -> float | None:
    room = min(of.mu_1 * (1 - epsilon) / (epsilon * sqrt(of.m)) for of in robots)

    def fits(h: float) -> bool:
        bound = bound_of(h)
        return bound is not None and (
            drive.kp_max * bound.position + drive.kd_max * bound.velocity <= room
        )

    low, high = SHORTEST, LONGEST
    while not fits(low):
        low *= 10
        if low >= LONGEST:
            return None
    for _ in range(HALVINGS):
        middle = sqrt(low * high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low
