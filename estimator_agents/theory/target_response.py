"""How far any target takes the estimates of any linear agents, by their response to its impulses.

Let a_0 be an impulse w after t_0, so that the target moves on at 1 m/s from then. The errors
u_k(w) at t_k are linear in w within a period, for positions at sampling times are: they follow from
what comes of impulses right after t_0 and right before t_1. Where the target sends its
acceleration, the errors v_k are what comes of a sample of 1 m/s² at t_0 alone. With what remains of
a target that goes straight on, S = lim u_k, the steady state has (statement W4)

    |x| ≤ γ2 (Σ_k ∫_0^h |u_k(w) − S| dw + Σ_k |v_k|) + γ1 |S|

whatever the agents keep, and however late their links are, each by a fixed time.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.theory.all_times import at_all_times
from nrs_cosim.estimator_agents.theory.delays import LateStep
from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.linear_step import NEAR

Array = NDArray[np.float64]

Weights = Sequence[tuple[int, Array]]
"""By delay, the weights (n,) of all that is received, of the target too."""
LEFT = 1e-13
"""The part of the sums at which they end."""
WORK = 3e8
"""Sampling periods of the past, times numbers that agents keep, that a sum may take."""


def worst_of_step(
    late: LateStep, gamma_1: float, gamma_2: float, radius: float, chord: float = 0.0
) -> tuple[EstimateBounds, EstimateBounds | None] | None:
    """Return bounds on the errors in steady state, for any target within γ1 and γ2.

    They are of sampling times, and of all times, as `all_times` has them. None where ρ = `radius` ≥
    1, where the target's sample is not that of an agent which is right, where those do not stay so
    at a target that rests, or where the past that counts is too long.
    """
    found, step = impulse_errors(late, radius), late.step
    if found is None:
        return None
    straight, errors = found
    back = np.linalg.inv(step.flow)
    sums = before = after = np.zeros(straight.shape)
    for k, (early, end, pulse) in enumerate(errors):
        added = _integral(early - straight, end - straight, step.h) + np.abs(pulse)
        sums = sums + added
        after = after + np.abs(back @ pulse)
        if k:  # what begins in a period does nothing right after the sampling time before it
            after = after + _integral(back @ (early - straight), back @ (end - straight), step.h)
        if added[:2].max() <= LEFT * (1 - radius) * sums[:2].max():
            before = gamma_2 * sums + gamma_1 * np.abs(straight)
            after = gamma_2 * after + gamma_1 * np.abs(back @ straight)
            position, velocity = before[:2].max(axis=1).tolist()
            always = at_all_times(step.flow, step.h, before, after, gamma_2, chord)
            return EstimateBounds(position, velocity), always
    return None


def impulse_errors(late: LateStep, radius: float) -> tuple[Array, Iterator[Array]] | None:
    """Return S, (s, n), and u_k at both ends of a period and v_k, (3, s, n), for k = 1, 2, …

    None as above; and no more of them than are worth the work.
    """
    step, n = late.step, late.topology.n
    E, agreed = step.truth, step.own + step.received
    right = step.agrees and np.allclose(agreed @ E[:, 0] - E[:, 0], 0, atol=NEAR)
    if radius >= 1 or not right:
        return None
    parts = late.parts()
    weights = [(d, np.asarray(D.sum(axis=1)).ravel() + own) for d, D, own in parts]
    slope = _given(late, weights, lambda d: np.array([-d * step.h, 1, 0]), np.array([step.h, 1, 0]))
    straight = np.zeros((len(E), n))
    if not np.allclose(slope, 0, atol=NEAR):
        straight = late.settled(1.0, slope, parts).real

    def errors() -> Iterator[Array]:
        x = np.zeros((len(E), n, 3))
        x[..., 2] = -(E @ [0, 0, 1])[:, None]  # of the sample at t_0 the agents know nothing yet
        recent, given = [np.zeros_like(x)] * late.longest + [x], x
        for k in range(int(WORK / x.size)):
            if k <= late.longest + 1:  # from then on it is the same
                given = _of_all(late, weights, k)
            x = late.advance(recent, parts) + given
            recent = [*recent[1:], x]
            yield np.moveaxis(x, -1, 0)

    return straight, errors()


def _of_all(late: LateStep, weights: Weights, k: int) -> Array:
    """Return what is given at t_k by impulses at both ends of a period, and by a sample."""
    h = late.step.h
    return np.stack(
        [
            _given(late, weights, lambda d: _moving(h, k - d, k, 0.0), _moving(h, k + 1, k, 0.0)),
            _given(late, weights, lambda d: _moving(h, k - d, k, h), _moving(h, k + 1, k, h)),
            _given(late, weights, lambda d: np.array([0, 0, k == d]), np.zeros(3)),
        ],
        axis=-1,
    )


def _moving(h: float, at: int, seen: int, w: float) -> Array:
    """Return z at t_at of the target that moves on from w, its position beside that at t_seen."""
    here = seen * h - w if seen >= 1 else 0.0
    return np.array([at * h - w - here, 1.0, 0.0]) if at >= 1 else np.array([-here, 0.0, 0.0])


def _given(late: LateStep, weights: Weights, sampled: Callable[[int], Array], then: Array) -> Array:
    """Return what z(t_{k−d}), by d, and z(t_{k+1}) come to in the errors of a period, (s, n)."""
    step, E = late.step, late.step.truth
    found: Array = (step.own @ E @ sampled(0) - E @ then)[:, None] * np.ones(late.topology.n)
    for d, by_robot in weights:
        found = found + (step.received @ E @ sampled(d))[:, None] * by_robot
    return found


def _integral(a: Array, b: Array, h: float) -> Array:
    """Return ∫_0^h |a + (b − a) w/h| dw."""
    size = np.abs(a) + np.abs(b)
    with np.errstate(invalid="ignore", divide="ignore"):
        crossing = np.where(size > 0, (a * a + b * b) / size, 0.0)
    found: Array = h / 2 * np.where(a * b >= 0, size, crossing)
    return found
