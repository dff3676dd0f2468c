"""Links that are late: x_i(t_{k+1}) = F K x_i(t_k) + Σ_j w_ij/ϖ_i F G S x_j(t_{k−d_ij}).

With D_d the part of D over links that are d sampling periods late, x(t_{k+1}) = F K ⊗ I x(t_k) +
Σ_d F G S ⊗ D_d x(t_{k−d}), which is a recursion of x and of what is under way (`late_states`).

- It converges iff ρ of that recursion is below 1 (statement D1). Where all links are late by the
  same d, its eigenvalues are those of [F K, …, s_i F G S] for each eigenvalue s_i of D.
- For a target of sines the errors settle to (e^{jωh} I − F K ⊗ I − F G S ⊗ Σ_d e^{−jωhd} D_d)⁻¹ Δ̂
  (statement D2): of the size of x, however late the links are.
- Where ρ(|F K| + ρ(D) |F G S|) < 1 it converges under any bounded delays, which may be drawn and be
  other ones on each link and at each tick, if agents hold what came last (statement D3).
- Else delays that are drawn are switching between the ages that samples may have (statement D4).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from math import nan, prod
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import (
    Matrix,
    as_array,
    identity_like,
    kron,
    matrix_of,
)
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Spectrum
from nrs_cosim.estimator_agents.target import Harmonic
from nrs_cosim.estimator_agents.theory.estimates import SteadyMotion
from nrs_cosim.estimator_agents.theory.late_states import (
    Delays,
    Past,
    block_radius,
    factors,
    is_proven,
)
from nrs_cosim.estimator_agents.theory.linear_step import NEAR, LinearStep
from nrs_cosim.estimator_agents.theory.outermost import within_of
from nrs_cosim.estimator_agents.theory.solving import solve
from nrs_cosim.estimator_agents.theory.varying import JointRadius, joint_spectral_radius

Array = NDArray[np.float64]

WORK = 2e8
"""Of eigenvalues of many small matrices: the cubes of their orders, added up."""
MARGIN_WORK, MOST = 1e7, 20
"""The same of all delays that are tried for the margin; and the longest of these."""
ORDERS = 8
"""Of delays that are drawn: combinations of ages up to which they are looked at."""


@dataclass(frozen=True, slots=True, eq=False)
class LateStep:
    """A sampling period over a digraph whose links are late, each by its own time."""

    step: LinearStep
    topology: Topology
    delay: Delays
    """(E,) sampling periods, of each edge."""
    oldest: Delays | None = None
    """(E,) the longest that there is at some time, where that is more."""

    @property
    def longest(self) -> int:
        """The longest delay, sampling periods."""
        return int(self.delay.max(initial=0))

    def parts(self) -> list[tuple[int, Matrix, Array]]:
        """Return each delay d, D_d, (n, n), and the target's weights over such links, (n,)."""
        topology, n = self.topology, self.topology.n
        found: list[tuple[int, Matrix, Array]] = []
        for d in np.unique(self.delay).tolist():
            here = self.delay == d
            among, pinned = here & (topology.source > 0), here & (topology.source == 0)
            rows, columns = topology.sink[among] - 1, topology.source[among] - 1
            part = matrix_of(rows, columns, topology.normalised[among], n)
            own = np.zeros(n)
            np.add.at(own, topology.sink[pinned] - 1, topology.normalised[pinned])
            found.append((int(d), part, own))
        return found

    def matrix(self) -> Matrix:
        """Return the recursion's matrix, of x and of the V x_j(t_{k−1}), … that are under way."""
        past = Past(self.step, self.topology, self.delay, self.oldest)
        received = past.received(np.arange(len(self.delay)), self.topology.normalised)
        return past.assembled([*past.own(), *past.kept(), *received])

    def radius(self, spectrum: Spectrum) -> float:
        """Return ρ, given the eigenvalues of D; not a number where it is too large to be found."""
        if (self.delay == self.longest).all():
            return common_radius(self.step, spectrum, self.longest)
        return block_radius(self.matrix())

    def is_proven(self, radius: float) -> bool:
        """Return whether it is proven on which side of 1 ρ is."""
        if (self.delay == self.longest).all():
            return True
        return is_proven(self.matrix(), radius)

    def advance(self, recent: Sequence[Array], parts: list[tuple[int, Matrix, Array]]) -> Array:
        """Return the errors one period after the last of some, each (s, n, m), without a target."""
        after: Array = np.tensordot(self.step.own, recent[-1], axes=1)
        for d, D, _ in parts:
            mean = np.stack([D @ field for field in recent[-1 - d]])
            after += np.tensordot(self.step.received, mean, axes=1)
        return after

    def settled(
        self, turn: complex, given: NDArray[Any], parts: list[tuple[int, Matrix, Array]]
    ) -> NDArray[np.complex128]:
        """Return (turn I − A)⁻¹ `given`, (s, n): what errors are where each period adds that."""
        step, one = self.step, identity_like(parts[0][1])
        mean = sum(D * turn**-d for d, D, _ in parts)
        unit = turn * kron(np.eye(len(step.fields)), one)
        A = kron(step.own, one) + kron(step.received, mean)
        return solve(unit - A, given.ravel()).reshape(given.shape)

    def steady_motion(self, target: Harmonic) -> SteadyMotion | None:
        """Return what the errors settle to where ρ < 1; None where it is not known.

        They are of all s fields. It is not known where the target sends what no agent does, and
        where agents that are right do not stay so at a target that rests.
        """
        step, n, s, h = self.step, self.topology.n, len(self.step.fields), self.step.h
        E, agreed = step.truth, step.own + step.received
        if not step.agrees or not np.allclose(agreed @ E[:, 0] - E[:, 0], 0, atol=NEAR):
            return None
        parts = self.parts()
        received = [np.asarray(D.sum(axis=1)).ravel() + own for _, D, own in parts]
        frequency, waves = target.phasors()
        phasor = np.zeros((len(frequency), s, n, waves.shape[1]), complex)
        for w, omega in enumerate(frequency):
            turn, z = np.exp(1j * omega * h), np.array([1, 1j * omega, -(omega**2)])
            mean = sum(part * turn**-d for (d, *_), part in zip(parts, received, strict=True))
            given = ((step.own - turn * np.eye(s)) @ E @ z)[:, None]
            given = given + (step.received @ E @ z)[:, None] * mean
            phasor[w] = self.settled(turn, given, parts)[..., None] * waves[w]
        slope = (step.own @ E[:, 1] - E[:, 1] - h * E[:, 0])[:, None] * np.ones(n)
        for (d, *_), part in zip(parts, received, strict=True):
            slope = slope + (step.received @ (E[:, 1] - d * h * E[:, 0]))[:, None] * part
        constant = np.zeros((s, n, waves.shape[1]))
        if not np.allclose(slope, 0, atol=NEAR):
            constant = self.settled(1.0, slope, parts).real[..., None] * target.rate
        return SteadyMotion(h, 1, constant, frequency, phasor)


def common_radius(step: LinearStep, spectrum: Spectrum, d: int, work: float = WORK) -> float:
    """Return ρ where all samples are late by d periods, given the eigenvalues of D.

    It is not a number where it is of more states than are looked at.
    """
    U, V = factors(step.received)
    s, r = U.shape
    values = spectrum[spectrum.imag >= 0]  # D is real: the others are their conjugates
    order = s + r * d
    if _work(step, spectrum, d) > work:
        return nan
    if d == 0:
        return float(np.abs(np.linalg.eigvals(step.blocks(values))).max())
    companion = np.zeros((len(values), order, order), np.complex128)
    companion[:, :s, :s] = step.own
    if r:
        companion[:, :s, -r:] = values[:, None, None] * U
        companion[:, s : s + r, :s] = V
        companion[:, s + r :, s:-r] = np.eye(order - s - r)
    return float(np.abs(np.linalg.eigvals(companion)).max())


def _work(step: LinearStep, spectrum: Spectrum, d: int) -> float:
    r = factors(step.received)[0].shape[1]
    return float(len(spectrum) * (len(step.fields) + r * d) ** 3)


def contraction(steps: Sequence[LinearStep], spectrum: Spectrum) -> float:
    """Return ρ(|F K| + ρ(D) |F G S|), with the largest entries that some periods have.

    Below 1 it converges whatever the delays, by statement D3.
    """
    own = np.max([np.abs(step.own) for step in steps], axis=0)
    received = np.max([np.abs(step.received) for step in steps], axis=0)
    whole = own + np.abs(spectrum).max() * received
    return float(np.abs(np.linalg.eigvals(whole)).max())


Margin = Literal["exact", "at least", "any"]


@dataclass(frozen=True, slots=True)
class DelayMargin:
    """How late all samples may be, all alike, so that the estimates still converge."""

    periods: int | None
    """The largest d such that they do at 0, 1, … d; None where they do not even at 0."""
    kind: Margin
    """Whether they diverge at d + 1, no more was tried or proven, or no delay is too long (D3)."""

    @property
    def refuted(self) -> bool:
        """Whether it is known that one sampling period is too late."""
        return self.periods == 0 and self.kind == "exact"


def delay_margin(step: LinearStep, spectrum: Spectrum) -> DelayMargin:
    """Return the delay margin, as far as it is looked for (statement D1)."""
    if contraction([step], spectrum) < 1:
        return DelayMargin(None, "any")
    left = MARGIN_WORK
    for d in range(MOST + 1):
        left -= _work(step, spectrum, d)
        if left < 0 and d:
            return DelayMargin(d - 1, "at least")
        if not common_radius(step, spectrum, d) < 1:
            kind: Margin = "exact" if within_of(spectrum) is None else "at least"
            return DelayMargin(d - 1 if d else None, kind)
    return DelayMargin(MOST, "at least")


def switching_radius(
    step: LinearStep, topology: Topology, least: Delays, most: Delays
) -> JointRadius | None:
    """Return bounds on the joint spectral radius of all ages that samples may have on each link.

    None where there are too many combinations of ages, or too many states.
    """
    of_robots = topology.source > 0  # an error of the target's samples is none of theirs
    last = np.where(of_robots, most, least)
    ages = [range(a, b + 1) for a, b in zip(least.tolist(), last.tolist(), strict=True)]
    if prod(map(len, ages)) > ORDERS:
        return None
    steps = (LateStep(step, topology, np.array(age, np.int64), most) for age in product(*ages))
    matrices = [as_array(one.matrix()) for one in steps]
    return joint_spectral_radius(matrices)
