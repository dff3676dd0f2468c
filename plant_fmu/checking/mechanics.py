"""M(q) q̈ + C(q, q̇) q̇ + G(q) = tau − friction, looked for from outside by accelerations alone.

M⁻¹ e_j = q̈(q, 0, e_j) − q̈(q, 0, 0) and G = −M q̈(q, 0, 0). Of the skew symmetry of Ṁ − 2C follows
d/dt(½ q̇'Mq̇) = q̇'(tau − G − friction). What C is wrong by is odd in q̇, and friction is even, so
that a pair of opposite q̇ tells one from the other.
"""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace

import numpy as np

from nrs_cosim.bus.plurals import numbered
from nrs_cosim.plant_fmu.archives.archive import Archive, unpacked
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.spans import agreeing, staircase
from nrs_cosim.plant_fmu.drives.choice import STEP, Offer
from nrs_cosim.plant_fmu.drives.grid import parts
from nrs_cosim.plant_fmu.drives.model_exchange import ModelExchangePlants
from nrs_cosim.plant_fmu.drives.own_law import without_own_law
from nrs_cosim.plant_fmu.drives.probe import Probe, under_torque
from nrs_cosim.plant_fmu.drives.rate import STEPS, Path, path
from nrs_cosim.plant_fmu.drives.runge_kutta import RungeKutta
from nrs_cosim.plant_fmu.drives.torque_held import TorqueHeldPlants
from nrs_cosim.plant_fmu.errors import FmuError, StillError
from nrs_cosim.plant_fmu.fmi.library import Kind, Library
from nrs_cosim.plant_fmu.plants import PD_ALONE, Array, Body

AHEAD = 1e-2
"""rad, or s along q̇: half the distance over which what depends on q is differentiated."""
HOLDING = 1.0
"""s: for how long it is to rest."""
TORQUE = frozenset({"rk4", "hold"})
"""Ways to drive a plant by any torque."""
_FORWARD = np.array([-25 / 12, 4, -3, 4 / 3, -1 / 4])
"""The derivative at the first of five equally spaced numbers, of order 4."""


@dataclass(frozen=True, slots=True)
class OpenProbe:
    """A plant to be probed, and how."""

    probe: Probe
    archive: Archive
    kind: Kind


def open_probe(
    stack: ExitStack,
    archive: Archive,
    body: Body,
    names: Mapping[str, Spec],
    offered: Sequence[Offer],
    chosen: Offer,
) -> OpenProbe:
    """Return a plant that takes any torque, of the interface that is chosen if it takes one.

    No law acts beside it, neither the body's nor one that the FMU holds. The stack ends it.
    `FmuError` where the FMU takes none.
    """
    ways = [offer for offer in offered if offer.way in TORQUE]
    if not ways:
        raise FmuError("it takes no tau")
    way = min(ways, key=lambda offer: offer.kind != chosen.kind)
    folder = stack.enter_context(unpacked(archive))
    library = stack.enter_context(Library(archive, folder, way.kind))
    alone, body = without_own_law(archive, names, body), replace(body, control=PD_ALONE)
    if way.kind == "CoSimulation":
        # inf: a torque is held for the whole of a step, so that no step is cut by the law.
        held = TorqueHeldPlants(library, [body], names, np.inf, heun=False, beside=alone)
        return OpenProbe(held, archive, way.kind)
    solved = ModelExchangePlants(
        library,
        [body],
        names,
        lambda robot: RungeKutta(robot, STEP),
        drive="",
        why="",
        beside=alone,
    )
    return OpenProbe(solved, archive, way.kind)


@dataclass(frozen=True, slots=True)
class Rest:
    """How a plant stays where its gravity is balanced by a constant torque."""

    drift: float
    """max |q − q0|, rad"""
    growth: float
    """Times which a deviation grows meanwhile by the linearised equations, at least 1."""


class MechanicsProbe:
    """One plant's equations, as they are found by starting it anew at postures."""

    def __init__(self, opened: OpenProbe, body: Body, budget: Budget) -> None:
        """Find in what steps it moves, and pushes that move each joint by about 1 rad/s².

        `FmuError` says why accelerations cannot be found.
        """
        self._probe, self._body, self._budget = opened.probe, body, budget
        self.states = 0
        """From how many states it was started."""
        self._pushes = np.ones(len(body.q))
        self._moves = False
        self.stairs = staircase(opened.archive, opened.kind, self._from_rest)
        self.spans, first = agreeing(self.stairs, lambda span: self.mobility(body.q, span))
        """s: between two velocities, the longer one and the shorter one"""
        sizes = np.sqrt((first**2).sum(axis=0))
        if still := (np.flatnonzero(sizes == 0) + 1).tolist():
            raise StillError(f"nothing moves by a torque on {numbered('joint', still)}")
        self._pushes /= sizes
        self._moves = True

    def acceleration(self, q: Array, qd: Array, tau: Array, span: float) -> Array:
        """Return q̈(q, q̇, tau), all (m,), found over a span in s.

        `FmuError` where the plant does not start there.
        """
        return np.asarray(_FORWARD @ self._velocities(q, qd, tau, span) / span, float)

    @property
    def start(self) -> Array:
        """(m,) where the robot starts, rad or m."""
        return self._body.q

    def mobility(self, q: Array, span: float) -> Array:
        """Return M⁻¹(q), (m, m), in SI, at q (m,), found over a span in s."""
        return self.from_rest(q, span)[0]

    def gravity(self, q: Array, span: float) -> Array:
        """Return G(q), (m,), N m or N, at q (m,), found over a span in s."""
        return np.asarray(-np.linalg.solve(*self.from_rest(q, span)), float)

    def from_rest(self, q: Array, span: float) -> tuple[Array, Array]:
        """Return M⁻¹(q), (m, m), and q̈(q, 0, 0), (m,), in SI, at q (m,), found over a span in s."""
        none = np.zeros(len(q))
        rest = self.acceleration(q, none, none, span)
        pushed = [self.acceleration(q, none, push, span) for push in np.diag(self._pushes)]
        inverse: Array = (np.array(pushed) - rest).T / self._pushes
        if self._moves and (still := (np.flatnonzero(~inverse.any(axis=0)) + 1).tolist()):
            raise FmuError(
                f"at q = {q.tolist()} nothing moves by a torque on {numbered('joint', still)}, "
                "though it did when it was first started; see the finding on its reset"
            )
        return inverse, rest

    def path(self, q: Array, qd: Array, side: float) -> Path:
        """Return how joints go from q at q̇, (m,), as pushes to a side, 1 or −1, move them.

        What q̇ is at the start is what it was told: only later ones are of the FMU's equations.
        """
        self._start(q, qd, side * self._pushes)
        span = self.spans[-1]
        return path(self._passed(span, STEPS + 1)[1:], span)

    def power_gained(self, q: Array, qd: Array, span: float) -> tuple[float, float]:
        """Return (d/dt(½ q̇'Mq̇) − q̇'(tau − G)) at tau = G, relative to its terms and q̇'Mq̇ / s.

        q and q̇ are (m,), and the span is in s. Beside it stands how much of that may be of the
        FMU's own steps d, of which an acceleration is known to d times its rate of change.
        """
        mass = np.linalg.inv(self.mobility(q, span))
        ahead, behind = (
            np.linalg.inv(self.mobility(q + side * qd, span)) for side in (AHEAD, -AHEAD)
        )
        velocities = self._velocities(q, qd, self.gravity(q, span), span)
        pull = qd @ mass @ (_FORWARD @ velocities) / span
        change = qd @ (ahead - behind) @ qd / (4 * AHEAD)
        size = abs(pull) + abs(change) + abs(qd @ mass @ qd)
        rate = (velocities[0] - 2 * velocities[1] + velocities[2]) / span**2
        doubt = self.stairs.internal * np.abs(qd @ mass) @ np.abs(rate)
        return float((pull + change) / size), float(doubt / size)

    def damping_rate(self, q: Array, span: float) -> float:
        """Return the fastest rate of M⁻¹(F + kd) at q (m,), 1/s: of damping over inertia."""
        m = len(q)
        none = np.zeros(m)
        drags = [
            self.acceleration(q, -way, none, span) - self.acceleration(q, way, none, span)
            for way in np.eye(m)
        ]
        rates = np.array(drags).T / 2 + self.mobility(q, span) @ self._body.kd
        return float(np.abs(np.linalg.eigvals(rates)).max())

    def rest(self, q: Array, span: float) -> Rest:
        """Start at rest at q (m,) with tau = G(q) held, and look where it goes."""
        none, tau = np.zeros(len(q)), self.gravity(q, span)
        slopes = [
            self.acceleration(q + aside, none, tau, span)
            - self.acceleration(q - aside, none, tau, span)
            for aside in AHEAD * np.eye(len(q))
        ]
        squared = np.linalg.eigvals(np.array(slopes).T / (2 * AHEAD)).astype(complex)
        # Of q̈ = A q from rest, a deviation along an eigenvector grows as cosh(√λ t).
        growth = float(np.cosh(np.sqrt(squared).real.max() * HOLDING))
        self._start(q, none, tau)
        drift = 0.0
        step = self.stairs.internal or STEP
        for j in range(parts(HOLDING, step)):
            self._advance(j * step, step)
            drift = max(drift, float(np.abs(self._probe.q[0] - q).max()))
        return Rest(drift, growth)

    def _velocities(self, q: Array, qd: Array, tau: Array, span: float) -> Array:
        """Return q̇ at five times that are a span apart, (5, m)."""
        self._start(q, qd, tau)
        return self._passed(span, len(_FORWARD) - 1)[:, 1]

    def _passed(self, span: float, steps: int) -> Array:
        """Return q and q̇ at times that are a span apart from now on, (steps + 1, 2, m)."""
        internal, time = self.stairs.internal, self.stairs.lead
        if time:
            self._advance(0.0, time)
        passed = [np.stack([self._probe.q[0], self._probe.qd[0]])]
        count = round(span / internal) if internal else 1
        for _ in range(steps):
            for _ in range(count):
                self._advance(time, span / count)
                time += span / count
            passed.append(np.stack([self._probe.q[0], self._probe.qd[0]]))
        return np.array(passed)

    def _from_rest(self, step: float, steps: int) -> Array:
        """Return q̇ from rest under a torque of 1 on each joint and under −1, (steps + 1, 2 m).

        One of them may be the torque under which it stays.
        """
        none = np.zeros(len(self._body.q))
        sides = []
        for torque in (none + 1, none - 1):
            self._start(self._body.q, none, torque)
            velocities = [self._probe.qd[0].copy()]
            for j in range(steps):
                self._advance(j * step, step)
                velocities.append(self._probe.qd[0].copy())
            sides.append(velocities)
        return np.hstack(sides)

    def _advance(self, start: float, step: float) -> None:
        self._probe.advance(start, step)
        self._budget.spend()

    def _start(self, q: Array, qd: Array, tau: Array) -> None:
        """Start anew under a constant torque alone."""
        self.states += 1
        self._probe.start_again([under_torque(self._body, q, qd, tau)])
        there = np.concatenate([self._probe.q[0], self._probe.qd[0]])
        if not np.allclose(there, np.concatenate([q, qd]), rtol=1e-9, atol=1e-9):
            raise FmuError(
                f"it was set to start at q, qd = {q.tolist()}, {qd.tolist()} and starts at "
                f"{there.tolist()}"
            )
