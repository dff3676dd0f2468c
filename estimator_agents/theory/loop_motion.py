"""How a robot of constant mass and viscous drag moves under PD gains: y ↦ Φ(t) y, y = [e; ė].

μ ë + (Kd + d I) ė + Kp e = 0. By it eᵀKp e + μ ėᵀė never grows, so that |row Φ(t) v| is at most
what the norms of both say of any t before: which bounds what Φ does between times at which it is
known.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import ceil, inf, log2

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

TERMS = 16
"""Of the exponential's series, where the matrix has a norm of a half at most."""
HALVINGS, MOST, COARSE = 40, 400, 8
"""Rounds in which cells of a grid are halved; cells there are at most then; and at first."""
MOST_OF_NORM, TOLERANCE = 4000, 1e-3
"""Of an integral over all times: cells at most, and the part of it that chords may miss."""
LONG, LONGEST = 30.0, 2**40
"""Time constants of the slowest motion, after which an integral is bounded by a norm; and periods
in which that is to fall by half."""


@dataclass(frozen=True, slots=True, eq=False)
class LoopMotion:
    """The free motion of m axes."""

    F: Array
    """(2 m, 2 m)"""
    energy: Array
    """(2 m, 2 m), of the norm that never grows."""

    @classmethod
    def of(cls, kp: Array, kd: Array, mass: float, drag: float) -> "LoopMotion":
        """Return that of gains (m, m), symmetric and positive definite."""
        one, none = np.eye(len(kp)), np.zeros(kp.shape)
        F = np.block([[none, one], [-kp / mass, -(kd + drag * one) / mass]])
        return cls(F, np.block([[kp, none], [none, mass * one]]))

    def at(self, times: Array) -> Array:
        """Return Φ at times (t,), s: (t, 2 m, 2 m)."""
        fast = np.sqrt(self.energy[0, 0] / self.energy[-1, -1])
        scale = np.repeat([fast, 1.0], len(self.F) // 2)
        F = self.F * scale[:, None] / scale
        size = float(np.abs(F).sum(axis=1).max() * times.max(initial=0.0))
        halved = max(0, ceil(log2(size)) + 1) if size > 0 else 0
        step = F * (times / 2.0**halved)[:, None, None]
        found = term = np.broadcast_to(np.eye(len(F)), step.shape)
        for k in range(1, TERMS + 1):
            term = term @ step / k
            found = found + term
        for _ in range(halved):
            found = found @ found
        whole: Array = found * scale / scale[:, None]
        return whole

    def bend(self, times: Array, at: Array) -> Array:
        """Return the most of each |Φ″| between neighbours of times, (t − 1, 2 m, 2 m)."""
        second = at @ self.F @ self.F
        fourth = second[:-1] @ self.F @ self.F
        sizes = np.sqrt(np.einsum("tij,tij->ti", fourth @ np.linalg.inv(self.energy), fourth))
        within = np.diff(times)[:, None, None] ** 2 / 8
        ends = np.maximum(np.abs(second[:-1]), np.abs(second[1:]))
        most: Array = ends + within * sizes[:, :, None] * np.sqrt(np.diag(self.energy))
        return most

    def pushed(self) -> Array:
        """Return ∫ |Φ(t)| dt over all t ≥ 0 at most, of each entry, (2 m, 2 m)."""
        rates = np.abs(np.linalg.eigvals(self.F).real)
        fastest = np.abs(np.linalg.eigvals(self.F)).max()
        end = LONG / rates.min()
        times = np.append(0.0, np.geomspace(min(0.01 / fastest, end / 64), end, 64))

        def missed(times: Array, at: Array) -> Array:
            return self.bend(times, at) * (np.diff(times) ** 3 / 12)[:, None, None]

        def coarse(times: Array, at: Array) -> NDArray[np.bool_]:
            whole = np.trapezoid(np.abs(at), times, axis=0)
            share = missed(times, at) / np.where(whole > 0, whole, 1.0)
            return np.asarray(share.max(axis=(1, 2)) > TOLERANCE / len(times))

        times, at = self.refined(times, coarse, MOST_OF_NORM)
        found = missed(times, at).sum(axis=0) + _moduli(times, at)
        rows = np.sqrt(np.diag(np.linalg.inv(self.energy)))
        whole: Array = found + self.remaining(end) * np.outer(rows, self.sizes(at[-1].T))
        return whole

    def sizes(self, states: Array) -> Array:
        """Return the norms of states, (…, 2 m), which only fall."""
        sizes: Array = np.sqrt(np.einsum("...i,ij,...j->...", states, self.energy, states))
        return sizes

    def remaining(self, h: float) -> float:
        """Return Σ h ‖Φ(k h)‖ over k = 0, 1, …, at most, s."""
        root, turned, periods = np.linalg.cholesky(self.energy).T, self.at(np.array([h]))[0], 1
        turned = root @ turned @ np.linalg.inv(root)
        while np.linalg.norm(turned, 2) > 1 / 2:
            turned, periods = turned @ turned, 2 * periods
            if periods > LONGEST:
                return inf
        return 2 * periods * h

    def refined(
        self, times: Array, coarse: Callable[[Array, Array], NDArray[np.bool_]], most: int
    ) -> tuple[Array, Array]:
        """Return times and Φ there, after the cells that are too coarse were halved."""
        at = self.at(times)
        for _ in range(HALVINGS):
            halved = np.flatnonzero(coarse(times, at))
            if not len(halved) or len(times) + len(halved) > most:
                break
            between = (times[halved] + times[halved + 1]) / 2
            times = np.insert(times, halved + 1, between)
            at = np.insert(at, halved + 1, self.at(between), axis=0)
        return times, at


def _moduli(times: Array, at: Array) -> Array:
    """Return ∫ |f| dt of what goes straight between its values, (t, …)."""
    from nrs_cosim.estimator_agents.theory.slow_modes import modulus  # noqa: PLC0415

    widths = np.diff(times).reshape(-1, *[1] * (at.ndim - 1))
    return np.asarray(modulus(at[:-1], at[1:], widths).sum(axis=0))
