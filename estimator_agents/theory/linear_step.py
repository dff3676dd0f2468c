"""One sampling period of a linear algorithm, whatever its agents keep and send: asked of the code.

Let x be what an agent keeps, s fields on one axis of m, and σ = S x what it sends. Where the law is
linear in x and in the weighted mean of what is received, one period takes x(t_k) to

    x_i(t_{k+1}) = F (K x_i + Σ_j w_ij/ϖ_i G σ_j)

and of all robots A = F K ⊗ I + F G S ⊗ D. Of an eigenvalue s_i of D the modes are those of
F (K + s_i G S). A state on which neither position nor velocity ever depends is left out: whatever
it does, the robot does not see it.

Fields of x that stand for a quantity of the target are E z, z = [ε_0; υ_0; a_0], where an agent is
right; the others are then 0. Where an agent that is right sends what the target sends, the error
x − 1 ⊗ E z obeys x(t_{k+1}) = A x(t_k) + 1 ⊗ [F (K + G S) E z(t_k) − E z(t_{k+1})], of which the
steady state is found as in `theory.estimates`.

K, G and S are found by letting one robot send and receive once, the axes of m being the cases that
are tried; and by other cases it is seen whether that is all there is to the law: at other times, of
other sizes, with several in-neighbours.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import TRUTHS, Fields
from nrs_cosim.bus.matrices import Matrix, identity_like, kron
from nrs_cosim.estimator_agents.algorithm import (
    Algorithm,
    Spectra,
    Spectrum,
    class_of,
    modes,
    overrides,
)
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.target import Target
from nrs_cosim.estimator_agents.values import Values

Array = NDArray[np.float64]

NEAR = 1e-9
"""Relative: how near to linear is linear."""
TRIED = ((1, 1.0), (1000, 1e-6), (4097, 1e6))
"""Sampling times, and sizes of the numbers, at which it is tried whether a law is linear."""
CASES = 8
"""Of random numbers at each; one more is all zeros."""
WEIGHTS = np.array([[0.5], [0.2], [0.3]])
"""Of three in-neighbours, one of them the target, whom others are tried with."""


@dataclass(frozen=True, slots=True, eq=False)
class LinearStep:
    """A sampling period of one robot, on one axis."""

    h: float
    """s"""
    fields: tuple[str, ...]
    """Of what an agent keeps the s that are seen: position, velocity, and others."""
    flow: Array
    """(s, s) F"""
    own: Array
    """(s, s) F K"""
    received: Array
    """(s, s) F G S"""
    sent: tuple[str, ...]
    """What an agent sends, q fields."""
    samples: Array
    """(s, q) F G"""
    truth: Array
    """(s, 3) E"""
    agrees: bool
    """Whether G S E z is what the target's own sample comes to."""
    ageless: bool
    """Whether a sample is taken as it is, however old it is."""
    alone: Array | None
    """(s, s) F K of a period in which no sample is delivered; None where the law takes other sums
    of those that are than the weighted mean."""

    def modes(self, spectrum: Spectrum) -> Spectrum:
        """Return the eigenvalues of the recursion, of those of D."""
        return np.linalg.eigvals(self.blocks(spectrum)).ravel().astype(np.complex128)

    def blocks(self, spectrum: Spectrum) -> Spectrum:
        """Return F (K + s_i G S) for each eigenvalue of D."""
        blocks: Spectrum = self.own + spectrum[:, None, None] * self.received
        return blocks

    def matrix(self, D: Matrix) -> Matrix:
        """Return A, (s n, s n), on a digraph."""
        return kron(self.own, identity_like(D)) + kron(self.received, D)

    def errors(self, state: Values, target: Target, seconds: float) -> Array:
        """Return x − 1 ⊗ E z of agents at a time, (s, n, m)."""
        motion = target.at(seconds)
        z = np.array([motion.position, motion.velocity, target.acceleration(seconds)])
        errors: Array = np.array([state[name] for name in self.fields]) - (self.truth @ z)[:, None]
        return errors


def linear_step(algorithm: Algorithm, h: float) -> LinearStep | None:
    """Return a period of h, s, of an algorithm; None where it is not known to be of that form.

    Of fields of other shapes than a position's, of own measurements, of what is kept of each
    in-neighbour and of those that decide when to send it is not known.
    """
    found = _tried(algorithm, h)
    return found if isinstance(found, LinearStep) else None


def why_not_linear(algorithm: Algorithm, h: float) -> str:
    """Return what a class raised when it was tried whether it is linear; nothing if none did.

    It may be made for one m alone, or for the times of a run.
    """
    found = _tried(algorithm, h)
    return f"tried with other numbers: {found}" if isinstance(found, Exception) else ""


def _tried(algorithm: Algorithm, h: float) -> LinearStep | Exception | None:
    kind = class_of(algorithm)
    fields = [*algorithm.STATE.values(), *algorithm.SENT.values()]
    others = algorithm.LINK or algorithm.TRIGGERED or algorithm.ARRIVALS != "newest"
    measures = overrides(kind, "measure") or overrides(kind, "observe")
    if others or measures or any(field.shape != ("m",) for field in fields):
        return None
    try:
        return _found(algorithm, h)
    except Exception as error:
        return error


def modes_of(algorithm: Algorithm, spectra: Spectra, h: float) -> Spectrum:
    """Return an algorithm's modes, or those of its code where it declares none; else none."""
    declared = modes(algorithm, spectra, h)
    if len(declared) or len(spectra) > 1:
        return declared
    step = linear_step(algorithm, h)
    return declared if step is None else step.modes(spectra[0])


def radius_of_list(algorithm: Algorithm, spectrum: Spectrum, gaps: Sequence[float]) -> float:
    """Return max ρ of a product of periods, over and over, as a factor per period.

    It is not a number where a period is not known.
    """
    steps = [linear_step(algorithm, h) for h in gaps]
    known = [step for step in steps if step is not None]
    if len(known) < len(steps):
        return nan
    blocks = [step.blocks(spectrum) for step in known]
    product, size = np.eye(blocks[0].shape[1], dtype=complex), np.zeros(len(spectrum))
    for block in blocks:
        product = block @ product
        most = np.abs(product).max(axis=(1, 2))
        product, size = product / most[:, None, None], size + np.log(most)
    radii = np.abs(np.linalg.eigvals(product)).max(axis=1)
    return float(np.exp((size + np.log(radii)) / len(gaps)).max())


def _found(algorithm: Algorithm, h: float) -> LinearStep | None:
    s, q = len(algorithm.STATE), len(algorithm.SENT)
    units, one = np.eye(s + q), np.ones((1, 1))
    F = _flow(algorithm, np.eye(s), h)
    E, T = _truth(algorithm.STATE), _truth(algorithm.SENT)
    R, S = _send(algorithm, np.eye(s), 1, h)
    after = _receive(algorithm, units[:s], units[None, s:], one, 1, h)
    K, G = after[:, :s] @ R, after[:, s:]
    rng = np.random.Generator(np.random.Philox(6))
    for k, size in TRIED:
        x = size * np.column_stack([rng.normal(size=(s, CASES)), np.zeros(s)])
        samples = size * rng.normal(size=(len(WEIGHTS), q, CASES + 1))
        samples[:, :, -1] = 0
        left, message = _send(algorithm, x, k, h)
        after = _receive(algorithm, left, samples, WEIGHTS, k, h)
        mean = (WEIGHTS[:, :, None] * samples).sum(axis=0)
        for found, expected in (
            (message, S @ x),
            (after, K @ x + G @ mean),
            (_flow(algorithm, after, h), F @ after),
        ):
            if not np.allclose(found / size, expected / size, rtol=NEAR, atol=NEAR):
                return None
    ageless, alone = _incomplete(algorithm, h, K, G, R)
    own, received = F @ K, F @ G @ S
    seen = _seen(list(algorithm.STATE), (own != 0) | (received != 0))
    agrees = np.allclose((received @ E)[seen], (F @ G @ T)[seen], rtol=NEAR, atol=NEAR)
    at = np.ix_(seen, seen)
    names = tuple(np.array(list(algorithm.STATE))[seen].tolist())
    sent, samples = tuple(algorithm.SENT), (F @ G)[seen]
    return LinearStep(
        h,
        names,
        F[at],
        own[at],
        received[at],
        sent,
        samples,
        E[seen],
        bool(agrees),
        ageless,
        None if alone is None else (F @ alone)[at],
    )


def _incomplete(
    algorithm: Algorithm, h: float, K: Array, G: Array, R: Array
) -> tuple[bool, Array | None]:
    """Return whether the age of samples is nothing to a law, and its K where none is delivered.

    The latter is None where it is not the mean of those that are that it takes.
    """
    s, q = len(R), G.shape[1]
    rng = np.random.Generator(np.random.Philox(7))
    x, samples = rng.normal(size=(s, CASES)), rng.normal(size=(len(WEIGHTS), q, CASES))
    some, none, ages = (np.array(of, np.int64) for of in ((1, 0, 1), (0, 0, 0), (3, 1, 2)))

    def after(x: Array, samples: Array, there: NDArray[np.int64], ages: NDArray[np.int64]) -> Array:
        return _receive(algorithm, x, samples, WEIGHTS, 9, h, there > 0, ages)

    mean = (WEIGHTS[:, :, None] * samples).sum(axis=0)
    whole, left = K @ x + G @ mean, R @ x
    ageless = np.allclose(after(left, samples, none == 0, ages), whole, rtol=NEAR, atol=NEAR)
    units = np.zeros((len(WEIGHTS), q, s))
    alone = after(R, units, none, 0 * ages)
    weights = WEIGHTS * some[:, None] / (WEIGHTS[:, 0] @ some)
    mean = (weights[:, :, None] * samples).sum(axis=0)
    tried = after(left, samples, some, 0 * ages), after(left, samples, none, 0 * ages)
    expected = K @ x + G @ mean, alone @ x
    means = np.allclose(tried, expected, rtol=NEAR, atol=NEAR)
    return bool(ageless), alone if means else None


def _seen(names: list[str], depends: NDArray[np.bool_]) -> NDArray[np.intp]:
    """Return the places of position, velocity, and what these depend on sooner or later."""
    first = [names.index(name) for name in ("position", "velocity")]
    seen = np.isin(np.arange(len(names)), first)
    for _ in names:
        seen = seen | depends[seen].any(axis=0)
    others = [at for at in np.flatnonzero(seen).tolist() if at not in first]
    return np.array([*first, *others])


def _truth(fields: Fields) -> Array:
    """Return what of z each field is, (fields, 3)."""
    return np.array([[field.truth == name for name in TRUTHS] for field in fields.values()], float)


def _send(algorithm: Algorithm, x: Array, k: int, h: float) -> tuple[Array, Array]:
    """Return the state afterwards, (s, c), and what is sent, (q, c), of c cases."""
    state, messages, _ = algorithm.send(_now(k, h, 1), _values(algorithm.STATE, x[:, None]))
    return _array(state, algorithm.STATE), _array(messages, algorithm.SENT)


def _receive(
    algorithm: Algorithm,
    x: Array,
    samples: Array,
    weights: Array,
    k: int,
    h: float,
    delivered: NDArray[np.bool_] | None = None,
    ages: NDArray[np.int64] | None = None,
) -> Array:
    """Return the state right after t_k, (s, c), of c cases; samples are (d, q, c) of d nodes."""
    d = len(samples)
    received = Received(
        np.zeros(d, np.intp),
        np.zeros(1, np.intp),
        np.arange(d) if d > 1 else np.array([2]),
        weights,
        _values(algorithm.SENT, samples.swapaxes(0, 1)),
        Values(),
        delivered,
        ages,
    )
    after = algorithm.receive(_now(k, h, d), _values(algorithm.STATE, x[:, None]), received)
    assert isinstance(after, Values)
    return _array(after, algorithm.STATE)


def _flow(algorithm: Algorithm, x: Array, h: float) -> Array:
    after = algorithm.flow(_values(algorithm.STATE, x[:, None]), h)
    return _array(after, algorithm.STATE)


def _now(k: int, h: float, d: int) -> Now:
    """Return t_k as a robot sees it that receives from d nodes, the target if from several."""
    nodes = np.arange(d) if d > 1 else np.array([2])
    edges = np.zeros(d, np.intp), nodes
    return Now(k, k * h, h, np.array([1]), np.ones((1, 1)), edges, np.array([d > 1]))


def _values(fields: Fields, numbers: Array) -> Values:
    return Values(zip(fields, numbers, strict=True))


def _array(values: Values, fields: Fields) -> Array:
    return np.concatenate([values[name] for name in fields])
