"""P3 of a plant of which only accelerations are known: the worst of many states, found by seed.

What depends on q̇ is even in it, by Coriolis, or odd, by drag; q̈ is that without a torque:

    C(v, q) v = −M [(q̈(q, v) + q̈(q, −v))/2 − q̈(q, 0)],   F v = −M [q̈(q, v) − q̈(q, −v)]/2,
    C(η, q) ξ = [C(η + ξ, q)(η + ξ) − C(η, q) η − C(ξ, q) ξ]/2,

for C(η, q) ξ = C(ξ, q) η, as Christoffel's symbols have it. Postures are drawn within ±π of each
joint, and from the worst one for each bound a search climbs on. Each bound is met at a state that
was looked at, so none is above the truth; nothing tells how far below it is.
"""

from collections.abc import Callable
from contextlib import ExitStack

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.bundled.bounds import Bounds
from nrs_cosim.plant_fmu.checking.budget import Budget, OverBudgetError
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.mechanics import MechanicsProbe, open_probe
from nrs_cosim.plant_fmu.checking.rates import rate_finding
from nrs_cosim.plant_fmu.drives.choice import choose, offers
from nrs_cosim.plant_fmu.drives.probe import SEED
from nrs_cosim.plant_fmu.drives.rate import NOT_THE_RATE
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.assignment import assignments, sizes_of
from nrs_cosim.plant_fmu.plants import Array

DRAWN, CLIMBING = 600, 350
"""States from which the plant is started: for the postures that are drawn, and for each climb."""
FIRST, LAST = np.pi / 8, 1e-3
"""rad: a climb's steps."""
TOLERANCE = 1e-2
"""Relative: of what is to be symmetric, or in proportion."""
DRAWN = 8
"""Directions of η from which the largest ‖C(η, q)‖₂ is sought."""

Measure = Callable[[Array], float]


def sampled(task: CheckTask, budget: Budget) -> Bounds:
    """Return P3 of a robot as it is found by sampling, in this process; `FmuError` says why not."""
    archive, body = task.archive, task.body
    assert body is not None
    budget.begin("sampling its mechanics")
    sizes = sizes_of(assignments(archive, body.parameters))
    offered = offers(archive, task.names, sizes)
    chosen = choose(archive, task.names, task.driving, sizes)
    with ExitStack() as stack:
        probe = open_probe(stack, archive, body, task.names, offered, chosen)
        mechanics, m = MechanicsProbe(probe, body, budget), len(body.q)
        rate = rate_finding(mechanics, [body.q] * 2, [np.arange(4, 4 + m) / 4 * s for s in (1, -1)])
        if rate.status == "fails":
            raise FmuError(f"{NOT_THE_RATE}: {rate.text}")
        return _Worst(mechanics).bounds(m)


def start_mobility(task: CheckTask) -> tuple[float, ...]:
    """Return (M⁻¹)_ii of each joint where a robot starts; `FmuError` says why it is not found."""
    archive, body = task.archive, task.body
    assert body is not None
    sizes = sizes_of(assignments(archive, body.parameters))
    offered = offers(archive, task.names, sizes)
    with ExitStack() as stack:
        probe = open_probe(stack, archive, body, task.names, offered, offered[0])
        mechanics = MechanicsProbe(probe, body, Budget())
        found = mechanics.mobility(body.q, mechanics.spans[0]).diagonal()
    return tuple(found.tolist())


class _Worst:
    """The worst that was seen of one plant."""

    def __init__(self, mechanics: MechanicsProbe) -> None:
        self._mechanics = mechanics
        self._least, self._most, self._weight = np.inf, 0.0, 0.0
        self._turning, self._drag = 0.0, 0.0
        self._mobility = np.zeros(0)

    def bounds(self, m: int) -> Bounds:
        """Draw, climb, and return the worst."""
        rest, all_of_it = m + 1, 1 + m + m * (m + 1)
        drawn = np.random.Generator(np.random.Philox(SEED))
        postures = drawn.uniform(-np.pi, np.pi, (max(4, DRAWN // all_of_it), m))
        seen, refusal = [], ""
        for q in postures:
            try:
                seen.append((*self._still(q), self._moving(q), q))
            except OverBudgetError:  # of all of it, and no posture's
                raise
            except CosimError as error:
                refusal = str(error)
        if not seen:
            raise FmuError(refusal)
        self._expect_proportion(seen[0][-1])
        climbs: list[tuple[int, Measure, int]] = [
            (0, lambda q: self._still(q)[0], rest),
            (1, lambda q: self._still(q)[1], rest),
            (2, lambda q: self._still(q)[2], rest),
            (3, self._moving, all_of_it),
        ]
        for which, measure, cost in climbs:
            best = max(seen, key=lambda row: row[which])
            _climb(measure, best[-1], best[which], CLIMBING // cost)
        return Bounds(
            self._least,
            self._most,
            self._turning,
            self._weight,
            self._drag,
            source="sampled",
            states=self._mechanics.states,
            mobility=tuple(self._mobility.tolist()),
        )

    def _still(self, q: Array) -> tuple[float, float, float]:
        """Return −λ_min(M), λ_max(M) and ‖G‖₂ at a posture."""
        mobility, falling = self._mechanics.from_rest(q, self._mechanics.spans[0])
        mass = _inverse(mobility)
        sizes = np.linalg.eigvalsh((mass + mass.T) / 2)
        weight = float(np.linalg.norm(mass @ falling))
        self._least = min(self._least, float(sizes[0]))
        self._most = max(self._most, float(sizes[-1]))
        self._weight = max(self._weight, weight)
        mobile = mobility.diagonal()
        self._mobility = np.maximum(self._mobility, mobile) if self._mobility.size else mobile
        return -float(sizes[0]), float(sizes[-1]), weight

    def _moving(self, q: Array) -> float:
        """Return sup ‖C(η, q)‖₂ over |η| = 1 at a posture."""
        m = len(q)
        mobility, falling = self._mechanics.from_rest(q, self._mechanics.spans[0])
        mass, axes = _inverse(mobility), np.eye(m)
        swings, drags = np.empty((m, m, m)), np.empty((m, m))
        for i in range(m):
            swings[:, i, i], drags[:, i] = self._parts(q, axes[i], mass, falling)
        for i in range(m):
            for j in range(i):
                both, _ = self._parts(q, axes[i] + axes[j], mass, falling)
                mixed = (both - swings[:, i, i] - swings[:, j, j]) / 2
                swings[:, i, j] = swings[:, j, i] = mixed
        turning = _largest(swings)
        self._turning = max(self._turning, turning)
        self._drag = max(self._drag, float(np.linalg.norm(drags, 2)))
        return turning

    def _parts(self, q: Array, v: Array, mass: Array, falling: Array) -> tuple[Array, Array]:
        """Return C(v, q) v and F v."""
        none = np.zeros(len(q))
        span = self._mechanics.spans[0]
        there, back = (self._mechanics.acceleration(q, way, none, span) for way in (v, -v))
        return -mass @ ((there + back) / 2 - falling), -mass @ (there - back) / 2

    def _expect_proportion(self, q: Array) -> None:
        """Raise `FmuError` unless drag is in proportion to q̇, and the rest to its square."""
        mobility, falling = self._mechanics.from_rest(q, self._mechanics.spans[0])
        mass, ones = _inverse(mobility), np.ones(len(q))
        once, twice = (self._parts(q, way * ones, mass, falling) for way in (1, 2))
        scale = sum(float(np.abs(part).max()) for part in (*twice, mass @ falling, mass @ ones))
        for part, power, what in (
            (0, 4, "its forces of motion are not in proportion to the square of q̇"),
            (1, 2, "its friction is not in proportion to q̇"),
        ):
            if np.abs(twice[part] - power * once[part]).max() > TOLERANCE * scale:
                internal = self._mechanics.stairs.internal
                or_else = f"its internal step of {internal:.3g} s is too long, or "
                raise FmuError(f"{or_else if internal else ''}{what}, and P3 knows of no other")


def _inverse(mobility: Array) -> Array:
    """Return M; `FmuError` where it is none."""
    size = np.abs(mobility).max()
    even = np.abs(mobility - mobility.T).max() <= TOLERANCE * size
    if not (np.isfinite(size) and even and np.linalg.eigvalsh((mobility + mobility.T) / 2)[0] > 0):
        raise FmuError("its inertia is not symmetric and positive definite; see nrs fmu check")
    return np.asarray(np.linalg.inv(mobility), float)


def _largest(swings: Array) -> float:
    """Return the largest ‖Σ η_i swings[:, i]‖₂ over |η| = 1, by turning η to where it grows."""
    m = len(swings)
    starts = np.random.Generator(np.random.Philox(SEED)).normal(size=(DRAWN, m))
    largest = 0.0
    for eta in [*np.eye(m), *starts]:
        turned, before = eta / np.linalg.norm(eta), -1.0
        while True:
            u, sizes, v = np.linalg.svd(np.einsum("kij,i->kj", swings, turned))
            if sizes[0] <= before * (1 + 1e-9):
                break
            before = sizes[0]
            pull = np.einsum("kij,k,j->i", swings, u[:, 0], v[0])
            length = np.linalg.norm(pull)
            if length == 0:
                break
            turned = pull / length
        largest = max(largest, float(sizes[0]))
    return largest


def _climb(measure: Measure, q: Array, best: float, looks: int) -> None:
    """Look around a posture, along the joints, for a larger value, ever nearer to the best."""
    step, sides = FIRST, [*np.eye(len(q)), *-np.eye(len(q))]
    while step > LAST:
        moved = False
        for side in sides:
            if not looks:
                return
            looks -= 1
            try:
                value = measure(q + step * side)
            except OverBudgetError:
                raise
            except CosimError:  # there the plant cannot be looked at; elsewhere it may be
                continue
            if value > best:
                q, best, moved = q + step * side, value, True
        if not moved:
            step /= 2
