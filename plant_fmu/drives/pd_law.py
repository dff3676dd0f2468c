"""tau = kp e + kd (υ(t) − qd) + ki z, within a limit; tau_d(t) acts beside it.

e = ε(t) − q, and z' = e, but less where the limit binds and e would push on, and 0 from a tenth of
it beyond on, as in controller.c. With s = t − t_hold, ε(t) = ε + s υ + s²/2 a and υ(t) = υ + s a;
of a line, without the terms in a.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nrs_cosim.bus.mathematics import sine
from nrs_cosim.bus.summation import summed
from nrs_cosim.plant_fmu.plants import Array, Body, Disturbance

SLACK = 0.1
"""Of a limit, in which an integral comes to rest beyond it."""


@dataclass(frozen=True, slots=True, eq=False)
class _Terms:
    """What of the law does not change while a reference is held, (rows, m)."""

    held: Array
    drift: Array
    """Per second since then."""
    held_disturbed: Array
    drift_disturbed: Array
    """With tau_d, without its waves."""
    curve: Array | None
    """Per second squared; None of lines."""


class Law:
    """Some robots' PD laws and disturbances, a row a robot; see the module for the equation."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._kp, self._kd = (np.array([getattr(b, gain) for b in bodies]) for gain in ("kp", "kd"))
        self._feedback = np.concatenate([self._kp, self._kd], axis=2)
        none = np.zeros_like(self._kp[0])
        self._ki = np.array([none if b.control.ki is None else b.control.ki for b in bodies])
        limits = [body.control.torque_limit for body in bodies]
        self._limit: Array | None = None
        if any(limit is not None for limit in limits):
            m = len(bodies[0].q)
            self._limit = np.array([np.full(m, np.inf) if x is None else x for x in limits])
        self._disturbance = Disturbance.stack([body.disturbance for body in bodies])
        d = self._disturbance
        self._waves = [
            (d.amplitude[..., p].copy(), d.frequency[..., p].copy(), d.phase[..., p].copy())
            for p in range(d.amplitude.shape[-1])
            if d.amplitude[..., p].any()
        ]
        self._terms: _Terms | None = None
        self.hold(
            0.0,
            np.array([body.position for body in bodies]),
            np.array([body.velocity for body in bodies]),
        )

    def hold(
        self, since: float, position: Array, velocity: Array, acceleration: Array | None = None
    ) -> None:
        """Take references (rows, m), rad, rad/s and rad/s², that move on from a time in s."""
        self.since, self._position, self._velocity = since, position.copy(), velocity.copy()
        self._acceleration = None if acceleration is None else acceleration.copy()
        self._terms = None

    @property
    def reference(self) -> Array:
        """(rows, 3 m) position, velocity and acceleration, as `take_up` takes them."""
        acceleration = self._acceleration
        if acceleration is None:
            acceleration = np.zeros_like(self._position)
        return np.hstack([self._position, self._velocity, acceleration])

    def take_up(self, since: float, reference: Array) -> None:
        """Hold what `reference` was, (rows, 3 m)."""
        position, velocity, acceleration = np.split(reference, 3, axis=1)
        self.hold(since, position, velocity, acceleration if acceleration.any() else None)

    def asked(self, seconds: float, state: Array, integral: Array | None = None) -> Array:
        """Return the law's torque (rows, m), N m, at a time in s and states (rows, 2 m), q and qd.

        The integral is z, (rows, m), rad s; without one it is the torque of PD alone.
        """
        terms, since = self._terms or self._find_terms(), seconds - self.since
        reference = terms.held + since * terms.drift
        if terms.curve is not None:
            reference += since * since * terms.curve
        torque: Array = reference - _times(self._feedback, state)
        return torque if integral is None else torque + _times(self._ki, integral)

    def integral_rate(self, seconds: float, state: Array, missing: Array) -> Array:
        """Return z', (rows, m), where so much of what is asked is not applied, (rows, m), N m."""
        since = seconds - self.since
        error = self._position + since * self._velocity - state[:, : missing.shape[1]]
        if self._acceleration is not None:
            error += since * since / 2 * self._acceleration
        if self._limit is None:
            return error
        pushes_on = missing * error > 0.0
        beyond = np.where(pushes_on, np.abs(missing) / (SLACK * self._limit), 0.0)
        return np.maximum(0.0, 1.0 - beyond) * error

    def torque(self, seconds: float, state: Array) -> Array:
        """Return tau (rows, m), N m: what of `asked` is within the limits."""
        return self.within_limits(self.asked(seconds, state))

    def within_limits(self, torque: Array) -> Array:
        """Return what of a torque (rows, m), N m, robots apply."""
        return torque if self._limit is None else np.clip(torque, -self._limit, self._limit)

    def effort(self, seconds: float, state: Array) -> Array:
        """Return tau + tau_d, (rows, m), N m: all that acts on the robots; see `torque`.

        Waves are added one after the other, so that those of zero change no bit.
        """
        if self._limit is not None:
            return self.disturbed(seconds, self.torque(seconds, state))
        terms, since = self._terms or self._find_terms(), seconds - self.since
        effort = terms.held_disturbed + since * terms.drift_disturbed
        if terms.curve is not None:
            effort += since * since * terms.curve
        effort -= _times(self._feedback, state)
        return self._with_waves(seconds, effort)

    def disturbed(self, seconds: float, torque: Array) -> Array:
        """Return a torque, (rows, m), with tau_d at a time in s."""
        d = self._disturbance
        return self._with_waves(seconds, torque + (d.offset + seconds * d.rate))

    def _with_waves(self, seconds: float, effort: Array) -> Array:
        for amplitude, frequency, phase in self._waves:
            effort += amplitude * sine(frequency * seconds + phase)
        return effort

    def _find_terms(self) -> _Terms:
        """Find what is asked of these references for the first time."""
        held = _times(self._kp, self._position) + _times(self._kd, self._velocity)
        drift, curve = _times(self._kp, self._velocity), None
        if self._acceleration is not None:
            drift += _times(self._kd, self._acceleration)
            curve = _times(self._kp, self._acceleration) / 2
        d = self._disturbance
        disturbed = held + d.offset + self.since * d.rate, drift + d.rate
        self._terms = _Terms(held, drift, *disturbed, curve)
        return self._terms


def _times(matrices: Array, vectors: Array) -> Array:
    """Multiply row by row: (rows, a, b) by (rows, b) is (rows, a)."""
    # No library of linear algebra: each adds in an order of its own, some multiply and add in one.
    product: Array = summed(matrices * vectors[:, None, :])
    return product
