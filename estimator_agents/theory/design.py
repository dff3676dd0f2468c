"""Gains and a period that give a wanted accuracy: as it is proven, and as the paper states it.

Proven (statement G5): multiples of I for which the balls of `tracking_bounds`, were the estimates
exact, are within a share of what is wanted, and the largest h for which they are within all of it
with the estimates' own worst cases. The balls vanish as both gains grow, so that there always are
such gains. Of those that just suffice, for several rates kp/kd, the ones with the least
kp δ + kd δ' are taken: the torque at the wanted errors. Of linear robots T5 then makes h longer.

The paper's (6.1) and (6.2), which rest on balls that its proof does not yield, with ϵ for the share
of the push ϱ3 that stays when the estimates are exact, ϱ3 = μ1/ϵ:

    λ_min(Kp) ≥ max(2 λ_M, μ1/(ϵ δ) + ϱ1),   λ_min(Kd) ≥ μ1/(ϵ δ') + ϱ2,
    h [κ1 λ_max(Kp) + min(κ1, κ2) λ_max(Kd)] ≤ μ1 (1 − ϵ)/(ϵ √m),

with κ3 for both κ in (6.2). The gains are the least, as multiples of I. The κ depend on h through A
and its norm, which the paper passes over: h is found between a period that is small enough and one
that is not, and the inequality is checked with the very κ of the h that is returned.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from math import sqrt
from typing import Any, Literal, TypeVar

import numpy as np

from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.tracking import Constants, worst_tracking
from nrs_cosim.estimator_agents.theory.tracking_bounds import Filtered, Loop, tracking_ball

SHORTEST, LONGEST, HALVINGS = 1e-9, 1e3, 24
"""s, s; and how often the logarithm of h is halved between them."""
DOUBLINGS, HALVED = 6, 8
"""How often a period is doubled by tight bounds, which take their time, and then halved so."""
MARGIN = 1e-9
"""By which the gains are above their least, for Theorems 2 and 3 want them greater."""
RATES = np.geomspace(1e-3, 1e3, 25)
"""kp/kd, per s."""
LEAST, LARGEST, CLOSE = 1e-3, 1e12, 1e-3
"""Between which kd is looked for, N m s; and how near to the least that suffices, relative."""
EXACT = EstimateBounds(0.0, 0.0)

BoundOf = Callable[[float], EstimateBounds | None]
"""Returns bounds on the estimates for a period in s; None where they are not known."""
KnownOf = Callable[[float], tuple[EstimateBounds, Filtered] | None]
"""Returns bounds at all times and what loops make of the estimates, for a period in s."""
TightOf = Callable[[float, float, float], EstimateBounds | None]
"""Returns a ball of all robots by T5, for a period in s, kp and kd; None where there is none."""
Known = TypeVar("Known")
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
    sampled: bool = False
    """Whether it rests on P3 of some robots as it was sampled."""

    def as_json(self) -> dict[str, Any]:
        """Return the design for JSON."""
        proven = self.proven.as_json() if self.proven else None
        return {"epsilon": self.epsilon, "proven": proven, "paper": self.paper.as_json()}


def design(
    robots: Sequence[tuple[Constants, Loop]],
    wanted: EstimateBounds,
    epsilon: float,
    paper: BoundOf,
    known: KnownOf,
    tight: TightOf | None = None,
) -> Design:
    """Return gains and the largest period for balls of e (rad) and of ė (rad/s).

    `paper` has δ1 and δ2 of Theorems 1 and 3; `known` what holds at all times; with `tight` ones
    the period may be longer.
    """
    of_paper = [constants for constants, _ in robots]
    kp = max(
        max(2 * of.lambda_M, of.mu_1 / (epsilon * wanted.position) + of.rho_1) for of in of_paper
    )
    kd = max(of.mu_1 / (epsilon * wanted.velocity) + of.rho_2 for of in of_paper)
    kp, kd = kp * (1 + MARGIN), kd * (1 + MARGIN)
    room = min(of.mu_1 * (1 - epsilon) / (epsilon * sqrt(of.m)) for of in of_paper)
    stated = Gains(kp, kd, *_longest(paper, lambda b: kp * b.position + kd * b.velocity <= room))
    loops = [loop for _, loop in robots]
    proven = _proven(loops, wanted, epsilon, known)
    if tight and proven and proven.period is not None:
        proven = replace(proven, period=_longer(proven, proven.period, wanted, tight))
    return Design(epsilon, proven, stated)


def _proven(
    loops: Sequence[Loop], wanted: EstimateBounds, share: float, known: KnownOf
) -> Gains | None:
    own = EstimateBounds(share * wanted.position, share * wanted.velocity)

    def ball(kp: float, kd: float, at: EstimateBounds, made: Filtered) -> EstimateBounds | None:
        unit = np.eye(loops[0].m)
        gained = [replace(loop, kp=kp * unit, kd=kd * unit) for loop in loops]
        return worst_tracking([tracking_ball(loop, at, made) for loop in gained])

    def least(rate: float) -> float | None:
        """Return the least kd that suffices: the larger both gains, the smaller is the ball."""
        low, high = LEAST, LEAST
        while not _within(ball(rate * high, high, EXACT, lambda _: EXACT), own):
            low, high = high, 4 * high
            if high > LARGEST:
                return None
        while high > low * (1 + CLOSE):
            middle = sqrt(low * high)
            enough = _within(ball(rate * middle, middle, EXACT, lambda _: EXACT), own)
            low, high = (low, middle) if enough else (middle, high)
        return high

    pairs = [(rate, least(rate)) for rate in RATES.tolist()]
    found = [(rate * kd, kd) for rate, kd in pairs if kd is not None]
    if not found:
        return None
    kp, kd = min(found, key=lambda pair: pair[0] * wanted.position + pair[1] * wanted.velocity)
    return Gains(kp, kd, *_longest(known, lambda one: _within(ball(kp, kd, *one), wanted)))


def _longer(gains: Gains, period: float, wanted: EstimateBounds, tight: TightOf) -> float:
    """Return a period, s, that tight bounds allow, no shorter than the one that others do."""

    def fits(h: float) -> bool:
        return _within(tight(h, gains.kp, gains.kd), wanted)

    low, high = period, 2 * period
    for _ in range(DOUBLINGS):
        if not fits(high):
            break
        low, high = high, 2 * high
    for _ in range(HALVED):
        middle = sqrt(low * high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _within(ball: EstimateBounds | None, wanted: EstimateBounds) -> bool:
    return (
        ball is not None and ball.position <= wanted.position and ball.velocity <= wanted.velocity
    )


def _longest(
    bound_of: Callable[[float], Known | None], kept: Callable[[Known], bool]
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
