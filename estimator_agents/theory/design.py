"""Gains and a period that give a wanted accuracy: as it is proven, and as the paper states it.

For some 0 < ϵ < 1, the share of the push ϱ3 that stays when the estimates are exact, ϱ3 = μ1/ϵ.

Proven: gains for which the balls of `tracking.proven` under that push are within what is wanted,
and the largest h for which they are so with the estimates' own bounds at all times. The balls
vanish with 1/Kp and 1/Kd, so that there always are such gains. Of those that just suffice, at
several ratios, the ones with the least Kp δ + Kd δ' are taken: the torque at the wanted errors.

The paper's (6.1) and (6.2), which rest on balls that its proof does not yield:

    λ_min(Kp) ≥ max(2 λ_M, μ1/(ϵ δ) + ϱ1),   λ_min(Kd) ≥ μ1/(ϵ δ') + ϱ2,
    h [κ1 λ_max(Kp) + min(κ1, κ2) λ_max(Kd)] ≤ μ1 (1 − ϵ)/(ϵ √m),

with κ3 for both κ in (6.2). The gains are the least, as multiples of I. The κ depend on h through A
and its norm, which the paper passes over: h is found between a period that is small enough and one
that is not, and the inequality is checked with the very κ of the h that is returned.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from math import sqrt
from typing import Any, Literal

import numpy as np

from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.tracking import Constants, Drive, proven, proven_under

SHORTEST, LONGEST, HALVINGS = 1e-9, 1e3, 24
"""s, s; and how often the logarithm of h is halved between them."""
MARGIN = 1e-9
"""By which the gains are above their least, for Theorems 2 and 3 want them greater."""
RATIOS = np.geomspace(1e-4, 1e4, 33)
"""Of the factors by which Kp and Kd are above the least that the theorems want."""
LARGEST = 1e12
"""The factor beyond which no gains are looked for."""

BoundOf = Callable[[float], EstimateBounds | None]
"""Returns bounds on the estimates for a period in s; None where they are not known."""
Status = Literal["found", "no bounds", "no period is short enough", "not computed"]


@dataclass(frozen=True, slots=True)
class Gains:
    """Multiples of I, and the longest period that goes with them."""

    kp: float
    """N m/rad"""
    kd: float
    """N m s/rad"""
    period: float | None
    """s; None where none is found."""
    bounds_from: float | None
    """s; the shortest of the periods that were tried whose bounds are known; None if of none."""

    @property
    def status(self) -> Status:
        """Whether a period is found, none is short enough, or bounds of short ones are missing."""
        if self.period is not None:
            return "found"
        if self.bounds_from is None:
            return "no bounds"
        return "no period is short enough" if self.bounds_from == SHORTEST else "not computed"

    def as_json(self) -> dict[str, float | str | None]:
        """Return the gains for JSON."""
        return {**asdict(self), "status": self.status}


@dataclass(frozen=True, slots=True)
class Design:
    """The gains and the period for an accuracy."""

    epsilon: float
    proven: Gains | None
    """None where λ_m of a robot is not known, or no gains are found."""
    paper: Gains
    """By (6.1) or (6.2): not proven."""

    def as_json(self) -> dict[str, Any]:
        """Return the design for JSON."""
        proven = self.proven.as_json() if self.proven else None
        return {"epsilon": self.epsilon, "proven": proven, "paper": self.paper.as_json()}


def design(
    robots: Sequence[Constants],
    wanted: EstimateBounds,
    epsilon: float,
    paper: BoundOf,
    always: BoundOf,
) -> Design:
    """Return gains and the largest period for balls of e (rad) and of ė (rad/s).

    `paper` has δ1 and δ2 of Theorems 1 and 3; `always` bounds that hold at all times.
    """
    kp = max(
        max(2 * of.lambda_M, of.mu_1 / (epsilon * wanted.position) + of.rho_1) for of in robots
    )
    kd = max(of.mu_1 / (epsilon * wanted.velocity) + of.rho_2 for of in robots)
    kp, kd = kp * (1 + MARGIN), kd * (1 + MARGIN)
    room = min(of.mu_1 * (1 - epsilon) / (epsilon * sqrt(of.m)) for of in robots)
    stated = Gains(kp, kd, *_longest(paper, lambda b: kp * b.position + kd * b.velocity <= room))
    return Design(epsilon, _proven(robots, wanted, epsilon, always), stated)


def _proven(
    robots: Sequence[Constants], wanted: EstimateBounds, epsilon: float, always: BoundOf
) -> Gains | None:
    of = _worst(robots)
    base = max(2 * of.lambda_M, of.rho_1) * (1 + MARGIN), of.rho_2 * (1 + MARGIN)

    def drive(ratio: float, factor: float) -> Drive:
        kp, kd = (own + own * factor * part for own, part in zip(base, (1, ratio), strict=True))
        return Drive(kp, kp, kd, kd)

    def enough(driven: Drive) -> bool:
        return _within(proven_under(of, driven, of.mu_1 / epsilon), wanted)

    found = []
    for ratio in RATIOS.tolist():
        high = 1.0
        while not enough(drive(ratio, high)) and high < LARGEST:
            high *= 4
        if high >= LARGEST:
            continue
        low = 0.0
        for _ in range(40):
            middle = (low + high) / 2
            low, high = (low, middle) if enough(drive(ratio, middle)) else (middle, high)
        found.append(drive(ratio, high))
    if not found:
        return None
    best = min(found, key=lambda d: d.kp_max * wanted.position + d.kd_max * wanted.velocity)

    def kept(bound: EstimateBounds) -> bool:
        return _within(proven(of, best, bound), wanted)

    return Gains(best.kp_min, best.kd_min, *_longest(always, kept))


def _worst(robots: Sequence[Constants]) -> Constants:
    """Return constants that are no better than any robot's: their balls are no smaller."""
    least = min(of.lambda_m for of in robots)
    names = ("lambda_M", "mu_1", "mu_2", "rho_1", "rho_2")
    return Constants(
        robots[0].m, least, *(max(getattr(of, name) for of in robots) for name in names)
    )


def _within(ball: EstimateBounds | None, wanted: EstimateBounds) -> bool:
    return (
        ball is not None and ball.position <= wanted.position and ball.velocity <= wanted.velocity
    )


def _longest(
    bound_of: BoundOf, kept: Callable[[EstimateBounds], bool]
) -> tuple[float | None, float | None]:
    """Return the longest period for whose bounds it is kept, and the shortest that has bounds.

    The shorter a period, the longer forgetting takes in periods: a sum over them may be given up.
    """

    def fits(h: float) -> bool:
        bound = bound_of(h)
        return bound is not None and kept(bound)

    low, high, known = SHORTEST, LONGEST, None
    while True:
        bound = bound_of(low)
        known = low if known is None and bound is not None else known
        if bound is not None and kept(bound):
            break
        low *= 10
        if low >= LONGEST:
            return None, known
    for _ in range(HALVINGS):
        middle = sqrt(low * high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low, known
