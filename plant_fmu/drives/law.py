"""tau = kp (ε(t) − q) + kd (υ − qd), with ε(t) = ε + (t − t_hold) υ; tau_d(t) acts beside it."""

from collections.abc import Sequence

import numpy as np

from plant_fmu.plants import Array, Body, Disturbance


class Law:
    """Some robots' PD laws and disturbances, a row a robot; see the module for the equation."""

    def __init__(self, bodies: Sequence[Body]) -> None:
        self._kp, self._kd = (np.array([getattr(b, gain) for b in bodies]) for gain in ("kp", "kd"))
        self._feedback = np.concatenate([self._kp, self._kd], axis=2)
        self._disturbance = Disturbance.stack([body.disturbance for body in bodies])
        d = self._disturbance
        self._waves = [
            (d.amplitude[..., p].copy(), d.frequency[..., p].copy(), d.phase[..., p].copy())
            for p in range(d.amplitude.shape[-1])
            if d.amplitude[..., p].any()
        ]
        self.hold(
            0.0,
            np.array([body.position for body in bodies]),
            np.array([body.velocity for body in bodies]),
        )

    def hold(self, since: float, position: Array, velocity: Array) -> None:
        """Take references (rows, m) that move on from a time in s."""
        self.since, self.position, self.velocity = since, position.copy(), velocity.copy()
        self._held = _times(self._kp, self.position) + _times(self._kd, self.velocity)
        self._drift = _times(self._kp, self.velocity)
        self._held_disturbed = (
            self._held + self._disturbance.offset + since * self._disturbance.rate
        )
        self._drift_disturbed = self._drift + self._disturbance.rate

    def torque(self, seconds: float, state: Array) -> Array:
        """Return tau, (rows, m), at the states (rows, 2 m) of q and then qd."""
        since = seconds - self.since
        return self._held + since * self._drift - _times(self._feedback, state)

    def effort(self, seconds: float, state: Array) -> Array:
        """Return tau + tau_d, (rows, m): all that acts on the robots.

        Waves are added one after the other, so that those of zero change no bit.
        """
        since = seconds - self.since
        effort = self._held_disturbed + since * self._drift_disturbed
        effort -= _times(self._feedback, state)
        for amplitude, frequency, phase in self._waves:
            effort += amplitude * np.sin(frequency * seconds + phase)
        return effort


def _times(matrices: Array, vectors: Array) -> Array:
    """Multiply row by row: (rows, a, b) by (rows, b) is (rows, a)."""
    product: Array = np.matmul(matrices, vectors[:, :, None])[:, :, 0]
    return product
