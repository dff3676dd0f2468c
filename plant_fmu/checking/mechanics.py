"""M(q) q̈ + C(q, q̇) q̇ + G(q) = tau − friction, looked for from outside by accelerations alone.

M⁻¹ e_j = q̈(q, 0, e_j) − q̈(q, 0, 0) and G = −M q̈(q, 0, 0). Of the skew symmetry of Ṁ − 2C follows
d/dt(½ q̇'Mq̇) = q̇'(tau − G − friction). What C is wrong by is odd in q̇, and friction is even, so
that a pair of opposite q̇ tells one from the other.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from plant_fmu.archives.archive import Archive, unpacked
from plant_fmu.archives.naming import Spec
from plant_fmu.drives.driving import STEP, Offer
from plant_fmu.drives.model_exchange import ModelExchangePlants
from plant_fmu.drives.probing import Probe
from plant_fmu.drives.runge_kutta import RungeKutta
from plant_fmu.drives.torque_held import TorqueHeldPlants
from plant_fmu.errors import FmuError
from plant_fmu.fmi.library import Library
from plant_fmu.plants import Array, Body, Disturbance

SPANS = (4e-3, 1e-3)
"""s, between two of the velocities of which an acceleration is found. What is wrong with an FMU is
wrong at each; an error of the probing itself is not."""
AHEAD = 1e-2
"""rad, or s along q̇: half the distance over which what depends on q is differentiated."""
HOLDING, LOOKS = 1.0, 50
"""s, and how often it is looked meanwhile."""
_FORWARD = np.array([-25 / 12, 4, -3, 4 / 3, -1 / 4])
"""The derivative at the first of five equally spaced numbers, of order 4."""


def open_probe(
    stack: ExitStack,
    archive: Archive,
    body: Body,
    names: Mapping[str, Spec],
    offered: Sequence[Offer],
    chosen: Offer,
) -> Probe:
    """Return a plant that takes any torque, of the interface that is chosen if it takes one.

    The stack ends it. `FmuError` where the FMU takes none.
    """
    ways = [offer for offer in offered if offer.way in {"rk4", "hold"}]
    if not ways:
        raise FmuError("it takes no tau")
    way = min(ways, key=lambda offer: offer.kind != chosen.kind)
    folder = stack.enter_context(unpacked(archive))
    library = stack.enter_context(Library(archive, folder, way.kind))
    if way.kind == "CoSimulation":
        return TorqueHeldPlants(library, [body], names, STEP, heun=False)
    return ModelExchangePlants(
        library, [body], names, lambda robot: RungeKutta(robot, STEP), drive="", why=""
    )


@dataclass(frozen=True, slots=True)
class Rest:
    """How a plant stays where its gravity is balanced by a constant torque."""

    drift: float
    """max |q − q0|, rad"""
    growth: float
    """Times which a deviation grows meanwhile by the linearised equations, at least 1."""


class Mechanics:
    """One plant's equations, as they are found by starting it anew at postures."""

    def __init__(self, probe: Probe, body: Body) -> None:
        """Find the pushes that change each joint's acceleration by about 1 rad/s²."""
        self._probe, self._body = probe, body
        self.states = 0
        """From how many states it was started."""
        self._pushes = np.ones(len(body.q))
        sizes = np.sqrt((self.mobility(body.q, SPANS[0]) ** 2).sum(axis=0))
        self._pushes[sizes > 0] /= sizes[sizes > 0]

    def acceleration(self, q: Array, qd: Array, tau: Array, span: float) -> Array:
        """Return q̈(q, q̇, tau), (m,); `FmuError` where the plant does not start there."""
        self._start(q, qd, tau)
        velocities = [self._probe.qd[0].copy()]
        for j in range(len(_FORWARD) - 1):
            self._probe.advance(j * span, span)
            velocities.append(self._probe.qd[0].copy())
        acceleration: Array = _FORWARD @ np.array(velocities) / span
        return acceleration

    def mobility(self, q: Array, span: float) -> Array:
        """Return M⁻¹(q), (m, m)."""
        return self.from_rest(q, span)[0]

    def gravity(self, q: Array, span: float) -> Array:
        """Return G(q), (m,)."""
        return np.asarray(-np.linalg.solve(*self.from_rest(q, span)), float)

    def from_rest(self, q: Array, span: float) -> tuple[Array, Array]:
        """Return M⁻¹(q), (m, m), and q̈(q, 0, 0), (m,)."""
        none = np.zeros(len(q))
        rest = self.acceleration(q, none, none, span)
        pushed = [self.acceleration(q, none, push, span) for push in np.diag(self._pushes)]
        inverse: Array = (np.array(pushed) - rest).T / self._pushes
        return inverse, rest

    def power_gained(self, q: Array, qd: Array, span: float) -> float:
        """Return (d/dt(½ q̇'Mq̇) − q̇'(tau − G)) at tau = G, relative to its terms and q̇'Mq̇ / s."""
        mass = np.linalg.inv(self.mobility(q, span))
        ahead, behind = (
            np.linalg.inv(self.mobility(q + side * qd, span)) for side in (AHEAD, -AHEAD)
        )
        acceleration = self.acceleration(q, qd, self.gravity(q, span), span)
        pull = qd @ mass @ acceleration
        change = qd @ (ahead - behind) @ qd / (4 * AHEAD)
        return float((pull + change) / (abs(pull) + abs(change) + abs(qd @ mass @ qd)))

    def rest(self, q: Array, span: float) -> Rest:
        """Start at rest with tau = G(q) held, and look where it goes."""
        none, tau = np.zeros(len(q)), self.gravity(q, span)
        slopes = [
            self.acceleration(q + aside, none, tau, span)
            - self.acceleration(q - aside, none, tau, span)
            for aside in AHEAD * np.eye(len(q))
        ]
        squared = np.linalg.eigvals(np.array(slopes).T / (2 * AHEAD)).astype(complex)
        growth = float(np.cosh(np.sqrt(squared).real.max() * HOLDING))
        self._start(q, none, tau)
        drift = 0.0
        for j in range(LOOKS):
            self._probe.advance(j * HOLDING / LOOKS, HOLDING / LOOKS)
            drift = max(drift, float(np.abs(self._probe.q[0] - q).max()))
        return Rest(drift, growth)

    def _start(self, q: Array, qd: Array, tau: Array) -> None:
        """Start anew under a constant torque alone."""
        m = len(q)
        self.states += 1
        none, torque = np.zeros((m, m)), Disturbance(tau, np.zeros(m), *np.zeros((3, m, 0)))
        self._probe.start_again(
            [replace(self._body, q=q, qd=qd, kp=none, kd=none, disturbance=torque)]
        )
        there = np.concatenate([self._probe.q[0], self._probe.qd[0]])
        if not np.allclose(there, np.concatenate([q, qd]), rtol=1e-9, atol=1e-9):
            raise FmuError(
                f"it was told to start at q, qd = {q.tolist()}, {qd.tolist()} and starts at "
                f"{there.tolist()}"
            )
