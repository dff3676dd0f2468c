"""What it adds to the bounds that samples of robots are not what is received, but near it.

Where each number that is received from robot j may be off by δ, x(t_{k+1}) = A x + F G ⊗ D δ + Δ(k)
with the recursion of what would be received. In steady state δ adds at most Σ_j |A^j F G ⊗ D| δ to
the error, which is (I − A)⁻¹ F G ⊗ D δ where nothing in it is negative (statement E1). So it is
with samples that are sent only when they say something new (`event_triggered`).

Rounding moves each number that is received by half a step at most, on each link another (N4).

An estimate jumps at t_k by G ⊗ (D − I) x + G ⊗ D δ: the most that it comes to is how soon there can
be something new to say (statement E2).
"""

from collections.abc import Mapping
from itertools import islice
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import ESTIMATE
from nrs_cosim.bus.matrices import FEW, Matrix, as_array, identity_like, kron
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.theory.all_times import at_all_times, is_straight
from nrs_cosim.estimator_agents.theory.estimates import (
    BLOCK,
    DENSE,
    EstimateBounds,
    history,
    worst,
)
from nrs_cosim.estimator_agents.theory.linear_step import LinearStep
from nrs_cosim.estimator_agents.theory.recursion import Recursion
from nrs_cosim.estimator_agents.theory.solving import solve

Array = NDArray[Any]
LEFT = 1e-13
"""The part of the sum at which it ends."""
MOST = 200_000
"""Sampling periods of the past that a sum may take."""


class Added(NamedTuple):
    """What errors of received samples add to bounds at most."""

    sampled: EstimateBounds
    """Right before sampling times."""
    always: EstimateBounds | None
    """At all times; None where that is not known."""


def received_errors(
    period: Recursion | LinearStep, D: Matrix, off: Mapping[str, float], radius: float
) -> Added | None:
    """Return what errors of up to `off`, by field that is sent, add in steady state on a digraph.

    None where ρ = `radius` ≥ 1, and of many robots where something in A is negative.
    """
    n = D.shape[0]
    if isinstance(period, LinearStep):
        A, samples, names = period.matrix(D), period.samples, period.sent
    else:
        A, samples, names = period.matrix, period.flow @ period.gain, tuple(ESTIMATE)
    errors = np.kron([off[name] for name in names], np.ones(n))
    return _added(A, kron(samples, D), period.flow, period.h, errors, n, radius)


def rounding_errors(
    step: LinearStep, A: Matrix, topology: Topology, steps: Mapping[str, Array], radius: float
) -> Added | None:
    """Return what rounding to multiples of `steps`, (E,) by field and edge, adds at most (N4).

    A is the recursion's matrix, of whose rows the first are x. None as above.
    """
    n, kernel = topology.n, kron(step.samples, identity_like(topology.D))
    off = np.concatenate(
        [
            np.bincount(topology.sink - 1, topology.normalised * steps[name] / 2, n)
            for name in step.sent
        ]
    )
    return _added(A, kernel, step.flow, step.h, off, n, radius)


def _added(
    A: Matrix, kernel: Matrix, flow: Array, h: float, errors: Array, n: int, radius: float
) -> Added | None:
    """Return Σ_j |A^j kernel| errors, and Σ_j |F⁻¹ A^j kernel| errors right after sampling times.

    The kernel is of the first rows of A, which are x, and h is the period.
    """
    if radius >= 1:
        return None
    x = kernel.shape[0]
    back = kron(np.linalg.inv(flow), identity_like(kernel[:n, :n]))
    after, given, rest = back @ A[:x, :x], kernel @ errors, A.shape[0] - x
    most = None
    if A.min() >= 0 and kernel.min() >= 0:
        most = solve(identity_like(A) - A, np.pad(given, (0, rest)))[:x]
    elif n <= FEW:
        most = _summed(as_array(A), _padded(kernel, rest), np.eye(x, A.shape[0]), errors, radius)
    if most is None:
        return None
    position, velocity = most.reshape(-1, n)[:2].max(axis=1).tolist()
    later = None
    if n <= FEW:
        seen = np.pad(as_array(back), ((0, 0), (0, rest)))
        later = _summed(as_array(A), _padded(kernel, rest), seen, errors, radius)
    elif most is not None and not rest and min(after.min(), (back @ kernel).min()) >= 0:
        later = back @ most
    always = None
    if later is not None and is_straight(flow, h):
        always = at_all_times(flow, h, most.reshape(-1, n), later.reshape(-1, n), 0.0, 0.0)
    return Added(EstimateBounds(position, velocity), always)


def _padded(kernel: Matrix, rest: int) -> Array:
    """Return it with rows of 0 for what is under way."""
    return np.pad(as_array(kernel), ((0, rest), (0, 0)))


def periods_between(
    triggered: Algorithm, period: Recursion | None, gamma_1: float, gamma_2: float, radius: float
) -> Array | None:
    """Return how many sampling periods lie at least between two samples of each robot, (n,).

    They are of the steady state, and of any target within γ1 and γ2. None where that is not known.
    """
    nominal = triggered.nominal()
    if not nominal or not period:
        return None
    jumps = largest_jumps(period, nominal[1], gamma_1, gamma_2, radius)
    if jumps is None:
        return None
    position, velocity = jumps
    return triggered.periods_between(position, velocity, period.h)


def largest_jumps(
    recursion: Recursion, off: Mapping[str, float], gamma_1: float, gamma_2: float, radius: float
) -> Array | None:
    """Return the most by which positions and velocities jump in steady state, (2, n).

    What is received may be `off`, and the target is any within γ1 and γ2. None as above, and of
    many robots.
    """
    n, D = recursion.n, as_array(recursion.D)
    if n > FEW or radius >= 1 or recursion.keep.tolist() != np.eye(2).tolist():
        return None
    h, pull = recursion.h, np.kron(recursion.gain, D - np.eye(n))
    followed = worst(recursion, gamma_1, gamma_2, radius, pull, h)
    errors = np.kron([off[name] for name in ESTIMATE], np.ones(n))
    kernel = np.kron(recursion.flow @ recursion.gain, D)
    received = _summed(as_array(recursion.matrix), kernel, pull, errors, radius)
    if followed is None or received is None:
        return None
    jumps: Array = followed + received + np.abs(np.kron(recursion.gain, D)) @ errors
    return jumps.reshape(2, n)


def _summed(A: Array, kernel: Array, seen: Array, errors: Array, radius: float) -> Array | None:
    """Return Σ_j |seen A^j kernel| errors; None where it takes too many terms."""
    most, left = np.zeros(len(seen)), np.zeros(len(A))
    block = BLOCK if len(A) <= DENSE else 1
    for kernels in islice(history(A, kernel, block), MOST // block):
        shown = (seen @ kernels.reshape(len(A), -1)).reshape(len(seen), *kernels.shape[1:])
        most += _weighed(shown, errors).sum(axis=1)
        added = _weighed(kernels, errors)
        left += added.sum(axis=1)
        if added[:, -1].max() <= LEFT * (1 - radius) * left.max():
            return most
    return None


def _weighed(kernels: Array, errors: Array) -> Array:
    """Return |kernels|, (r, c, b), times errors (c,): (r, b)."""
    if kernels.shape[2] == 1:  # by BLAS, which einsum does not take here
        return (np.abs(kernels[:, :, 0]) @ errors)[:, None]
    weighed: Array = np.einsum("rcb,c->rb", np.abs(kernels), errors)
    return weighed
