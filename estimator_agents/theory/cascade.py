"""Robots of constant mass and viscous drag behind their estimates, in one recursion (statement T5).

Of M = μ I and drag d, with the unit vector 1 of an axis, a reference that moves on at ε̄_i, ῡ_i on
it is followed at e = 1 ε̄_i − Kp⁻¹ 1 d (ῡ_i + υ_0), ė = 1 ῡ_i. What a robot is off that, y, is
moved by its loop alone, y ↦ Φ(t) y, and by jumps of the reference: what the target does between
two sampling times does not change it. So the worst of e and ė at t_k + τ is found as that of
estimates is (W2), from their responses to a target that begins to move.

In τ only Φ(τ) is curved: between times of a grid it is near its chord, by (Δτ)²/8 sup |Φ″|, and
the target's part since t_k is no more than at the later one. τ_d adds ∫ |Φ(t)| dt/μ on each axis.
"""

from dataclasses import dataclass, replace
from itertools import product
from math import log

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.theory.estimates import EstimateBounds
from nrs_cosim.estimator_agents.theory.loop_motion import COARSE, MOST, LoopMotion
from nrs_cosim.estimator_agents.theory.slow_modes import modulus
from nrs_cosim.estimator_agents.theory.step_responses import PERIODS, Steps
from nrs_cosim.estimator_agents.theory.tracking_bounds import Loop
from nrs_cosim.estimator_agents.theory.worst_case import NEAR, Response, bound_of

Array = NDArray[np.float64]

ROBOTS, WORK = 64, 1e8
"""Robots of the same gains, and numbers of their responses, that are looked at, at most."""
BENT = 0.003
"""The part of a bound that may be added for what is curved."""
LEVELS = np.append(0.0, np.geomspace(0.02, 1.0, 11))
"""Parts of the largest |N| at which u follows it no farther."""
REST = 1e-4
"""The part of a motion at which the past ends; what is left of it is bounded by its norm."""
LOOKED_AT, TOGETHER = 2, 16
"""Times and robots whose worst target is looked for; and times that are looked at at once."""
LOOKED_INTO = 5e3
"""Numbers that the past may be of, for the former."""
TINY = float(np.finfo(float).tiny)


def cascade_ball(loop: Loop, steps: Steps, robots: NDArray[np.intp]) -> EstimateBounds | None:
    """Return radii of balls of e and ė of some robots with that loop, counted from 0.

    None of a robot that is not linear, where the past that counts is too long, or of too much.
    """
    p3, kp, kd = loop.p3, loop.kp, loop.kd
    definite = min(np.linalg.eigvalsh(kp)[0], np.linalg.eigvalsh(kd)[0]) > 0
    linear = not (p3.lambda_c or p3.lambda_g) and 0 < p3.lambda_m == p3.lambda_M
    if not linear or not definite or len(robots) > ROBOTS:
        return None
    found, lambda_d = [], np.array(loop.lambda_d)
    alike = all(np.array_equal(K, K[0, 0] * np.eye(loop.m)) for K in (kp, kd))
    for axes in [[0]] if alike else _together(loop):
        at = np.ix_(axes, axes)
        part = _Part(kp[at], kd[at], p3.lambda_M, p3.lambda_f, loop.gammas, lambda_d[axes])
        radii = part.alike(loop, steps, robots) if alike else part.radii(steps, robots)
        if radii is None:
            return None
        found.append(radii)
    position, velocity = np.linalg.norm(found, axis=0).tolist()
    return EstimateBounds(position, velocity)


def _together(loop: Loop) -> list[list[int]]:
    """Return the axes that gains couple."""
    joined = ((loop.kp != 0) | (loop.kd != 0)).astype(int)
    reached = np.linalg.matrix_power(joined, loop.m) > 0
    return [list(axes) for axes in sorted({tuple(np.flatnonzero(row).tolist()) for row in reached})]


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """Axes that gains couple."""

    kp: Array
    """(m, m), as kd."""
    kd: Array
    mass: float
    drag: float
    gammas: tuple[float, float]
    lambda_d: Array
    """(m,)"""

    def alike(
        self, loop: Loop, steps: Steps, robots: NDArray[np.intp]
    ) -> tuple[float, float] | None:
        """Return the most of ‖e‖₂ and ‖ė‖₂ where all axes are as this one, of whatever direction.

        A direction is an axis whose γ's are the most of ‖υ_0‖₂ and ‖a_0‖₂.
        """
        alone = replace(self, lambda_d=np.zeros(1))
        disturbed = np.outer(self.motion.pushed()[:, 1] / self.mass, loop.lambda_d)
        each, norms = alone.radii(steps, robots), (loop.speed, loop.pull)
        any_way = replace(alone, gammas=norms).radii(steps, robots)
        if each is None or any_way is None:
            return None
        by_axis = np.linalg.norm(np.array(each)[:, None] + disturbed, axis=1)
        position, velocity = np.minimum(by_axis, any_way + np.linalg.norm(disturbed, axis=1))
        return float(position), float(velocity)

    @property
    def motion(self) -> LoopMotion:
        return LoopMotion.of(self.kp, self.kd, self.mass, self.drag)

    def radii(self, steps: Steps, robots: NDArray[np.intp]) -> tuple[float, float] | None:
        """Return the most of ‖e‖₂ and ‖ė‖₂ on these axes; None where it is too much work."""
        m, motion = len(self.kp), self.motion
        past = _Past.of(self, motion, steps, robots)
        if past is None:
            return None
        disturbed = motion.pushed()[:, m:] @ self.lambda_d / self.mass
        away = np.broadcast_to(np.eye(2 * m, 2 * m + 3, 2), (m, 1, 2 * m, 2 * m + 3))
        levels = np.broadcast_to(LEVELS, (len(robots), 2 * m, m, len(LEVELS)))
        off = past.simple(away, levels).min(axis=-1).sum(axis=-1)
        times = np.linspace(0.0, steps.h, COARSE + 1)
        first = past.simple(past.rows(times, motion.at(times)), levels)
        scale = first.min(axis=-1).sum(axis=-1).max(axis=(0, 1)) + disturbed + TINY
        best = first.max(axis=0).argmin(axis=-1)[..., None]

        def bent(times: Array, at: Array) -> Array:
            """Return what is added in each cell, (cells, robots, 2 m)."""
            within = np.diff(times)[:, None, None] ** 2 / 8
            added: Array = within * (off[0] @ motion.bend(times, at).swapaxes(1, 2))
            return added

        times, at = motion.refined(
            times, lambda *grid: (bent(*grid) / scale).max(axis=(1, 2)) > BENT, MOST
        )
        if len(times) * past.states.size > WORK:
            return None
        rows, now = past.rows(times, at), self._now(times)
        simple = past.simple(rows, np.take_along_axis(levels, best, axis=-1))[..., 0]
        either = np.maximum(
            *((part + now[1:, None]).sum(axis=-1) for part in (simple[:-1], simple[1:]))
        )
        added = bent(times, at) + disturbed
        position, velocity = (
            self._largest(either + added, added, half, past, rows, times)
            for half in (slice(None, m), slice(m, None))
        )
        return position, velocity

    def _now(self, times: Array) -> Array:
        """Return what the target's part since t_k adds by times, (t, 2 m, m)."""
        h, (gamma_1, gamma_2), one = times[:, None, None], self.gammas, np.eye(len(self.kp))
        turned = np.minimum(h, 2 * gamma_1 / gamma_2) if gamma_2 else 0 * h
        most = gamma_2 * turned
        now: Array = np.concatenate([most * (h - turned / 2) * one, most * one], axis=1)
        return now

    def _largest(
        self, simple: Array, added: Array, half: slice, past: "_Past", rows: Array, times: Array
    ) -> float:
        """Return the largest ‖·‖₂ of bounds, (cells, robots, 2 m); the first are made exact."""
        sizes = np.linalg.norm(simple[..., half], axis=-1)
        allowed = LOOKED_AT if past.states[..., 0].size <= LOOKED_INTO else 0
        best = 0.0
        for looked_at, place in enumerate(np.argsort(-sizes, axis=None).tolist()):
            bound = float(sizes.flat[place])
            if looked_at == allowed or bound <= best * (1 + NEAR):
                return max(best, bound)
            cell, robot = divmod(place, sizes.shape[1])
            velocity = half.start is not None
            found = past.exact(robot, rows[:, cell : cell + 2, half], velocity, times[cell + 1])
            exact = float(np.linalg.norm(found + added[cell, robot, half]))
            best = max(best, min(exact, bound))
        return best


@dataclass(frozen=True, slots=True, eq=False)
class _Past:
    """What references, and robots off these, come to by what the target did in each period."""

    part: _Part
    h: float
    states: Array
    """(m, robots, 2 m + 3, P, e): ε̄, ῡ, y and υ_0, by the axis on which the target moves."""
    limit: Array
    """(m, robots, 2 m + 3), for P → ∞."""
    lag: Array
    """(m, m) Kp⁻¹ d"""
    older: Array
    """(m, robots) s, ∫ ‖y − y(∞)‖ over the past that is left out, in the norm of energy."""
    dual: Array
    """(2 m, 2 m), of the dual norm."""

    @classmethod
    def of(
        cls, part: _Part, motion: LoopMotion, steps: Steps, robots: NDArray[np.intp]
    ) -> "_Past | None":
        """Return it; None where the past that counts is too long."""
        m, h, (known, e) = len(part.kp), steps.h, steps.after.shape[:2]
        lag: Array = (part.drag * np.linalg.inv(part.kp)).astype(np.float64)
        turn = motion.at(np.array([h]))[0]
        slowest = float(np.abs(np.linalg.eigvals(turn)).max())
        P = known + (int(log(REST) / log(max(slowest, REST))) + 1 if slowest < 1 else PERIODS)
        if P >= PERIODS or P * e * len(robots) * m * (2 * m + 3) > WORK:
            return None
        F, moving = np.array([[1.0, h], [0.0, 1.0]]), np.array([1.0, 1.0, 0.0])[:e]
        limit = steps.limit[:, robots]
        after = np.empty((P, e, 2, len(robots)))
        after[:known], after[known:] = steps.after[..., robots], moving[:, None, None] * limit
        before = np.concatenate([np.zeros((1, *after.shape[1:])), F @ after[:-1]])
        before[0] += steps.begun[:, :, None]
        one, none = np.eye(m), np.zeros((m, m))
        follows = np.stack([np.block([[one], [none]]), np.block([[-lag], [one]])], axis=-1)
        kicks = np.einsum("rlx,pexn->plner", follows, after - before)
        y, states = np.zeros(kicks.shape[1:]), np.empty((P, *kicks.shape[1:4], 2 * m + 3))
        states[..., :2] = after.transpose(0, 3, 1, 2)[:, None]
        states[..., -1] = moving
        for j, kick in enumerate(kicks):
            states[j, ..., 2:-1] = y - kick
            y = states[j, ..., 2:-1] @ turn.T
        kick = np.einsum("rlx,xn->lnr", follows, limit - F @ limit)
        rest = -kick @ np.linalg.inv(np.eye(2 * m) - turn).T
        straight = np.broadcast_to(limit.T, (m, len(robots), 2))
        last = np.concatenate([straight, rest, np.ones((m, len(robots), 1))], axis=-1)
        apart = motion.sizes(y - moving[:, None] * (rest @ turn.T)[:, :, None])
        left = motion.remaining(h)
        older = left * apart[..., :2].max(axis=-1) + left / h * apart[..., 2:].sum(axis=-1)
        return cls(
            part,
            h,
            states.transpose(1, 2, 4, 0, 3),
            last,
            lag,
            older.astype(np.float64),
            np.linalg.inv(motion.energy).astype(np.float64),
        )

    def rows(self, times: Array, at: Array) -> Array:
        """Return e and ė at times after t_k, of the states right then, (m, t, 2 m, 2 m + 3)."""
        m = len(self.lag)
        rows = np.zeros((m, len(times), 2 * m, 2 * m + 3))
        rows[..., 2:-1] = at
        for axis in range(m):
            rows[axis, :, axis, 0] = rows[axis, :, m + axis, 1] = 1
            rows[axis, :, axis, 1] = times
            rows[axis, :, :m, 1] -= self.lag[:, axis]
            rows[axis, :, :m, -1] = -self.lag[:, axis]
        return rows

    def simple(self, rows: Array, levels: Array) -> Array:
        """Return bounds on rows, (t, robots, 2 m, m, levels), by axis on which the target moves.

        u of W2 follows N, or its mean in each period, up to a level, each of some, in parts of the
        largest |N|, and then jumps to S.
        """
        m, n = self.states.shape[:2]
        found = np.empty((rows.shape[1], *levels.shape))
        for axis, i in product(range(m), range(n)):
            for some in range(0, len(found), TOGETHER):
                now = slice(some, some + TOGETHER)
                found[now, i, :, axis] = self._simple(rows[axis, now], axis, i, levels[i, :, axis])
        return found

    def _simple(self, rows: Array, axis: int, i: int, levels: Array) -> Array:
        (gamma_1, gamma_2), h = self.part.gammas, self.h
        S, whole = rows @ self.limit[axis, i], np.tensordot(rows, self.states[axis, i], axes=1)
        end, begin = (S[..., None] - whole[..., k] for k in (0, 1))
        most = np.maximum(np.abs(end), np.abs(begin)).max(axis=-1, keepdims=True)
        found = []
        for level in levels.T:
            size = level[:, None] * most
            late, early, held = (np.clip(N, -size, size) for N in (end, begin, (end + begin) / 2))
            beyond = [modulus(begin - off, end - off, h) for off in (size, -size)]
            missed = (sum(beyond) / 2 - size * h, modulus(begin - held, end - held, h))
            turned = _turned(late, early, S), _turned(held, held, S)
            both = (
                gamma_1 * turns + gamma_2 * miss.sum(axis=-1)
                for turns, miss in zip(turned, missed, strict=True)
            )
            found.append(np.minimum(*both))
        return np.stack(found, axis=-1) + self._others(rows, whole, axis, i)[..., None]

    def _others(self, rows: Array, whole: Array, axis: int, i: int) -> Array:
        """Return what accelerations that are sent add, and what comes of longer ago."""
        sizes = np.sqrt(np.einsum("...i,ij,...j->...", y := rows[..., 2:-1], self.dual, y))
        pulses: Array = np.abs(whole[..., 2:]).sum(axis=(-1, -2))
        added: Array = self.part.gammas[1] * (pulses + sizes * self.older[axis, i])
        return added

    def exact(self, robot: int, rows: Array, velocity: bool, tau: float) -> Array:
        """Return bounds, (m,), on rows of both ends of a cell, (m, 2, m, 2 m + 3), at the later."""
        gammas, found = self.part.gammas, np.zeros(rows.shape[1:3])
        for axis, q, r in np.ndindex(*rows.shape[:3]):
            row, states = rows[axis, q, r], self.states[axis, robot]
            S, whole = float(row @ self.limit[axis, robot]), np.tensordot(row, states, axes=1)
            end, begin, moved = S - whole[:, 0], S - whole[:, 1], float(axis == r)
            response = Response(
                np.append(tau, np.full(len(end), self.h)),
                np.append(0.0 if velocity else moved, (begin - end) / self.h),
                np.append(S + moved * velocity, end),
                np.zeros(2),
                S,
            )
            found[q, r] += bound_of(response, *gammas) + self._others(row, whole, axis, robot)
        most: Array = found.max(axis=0)
        return most


def _turned(end: Array, begin: Array, S: Array) -> Array:
    """Return the variation of what goes straight in each period, the last one first, then to S."""
    jumps = np.abs(begin[..., :-1] - end[..., 1:]).sum(axis=-1) + np.abs(begin[..., -1])
    turned: Array = jumps + np.abs(end - begin).sum(axis=-1) + np.abs(S - end[..., 0])
    return turned
