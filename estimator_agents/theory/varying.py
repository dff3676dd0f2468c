"""The worst order of some matrices: what their joint spectral radius ρ̂ lies between.

ρ̂ = lim max ‖A_{i_k} ⋯ A_{i_1}‖^{1/k} over all orders (Rota and Strang 1960): the factor of
x⁺ = A_i x in steady state, if the worst i comes each time. It is below 1 iff x → 0 in every order.
Of products, and in any norm, with ‖·‖_j = ‖A_{i_j} ⋯ A_{i_1}‖^{1/j},

    ρ(A_{i_k} ⋯ A_{i_1})^{1/k} ≤ ρ̂ ≤ max over i_1 … i_k of min over j ≤ k of ‖·‖_j.

Gripenberg's search (Linear Algebra and its Applications 234, 1996) makes products longer where
that minimum is not near the lower bound yet. The norm is ‖S⁻¹ · S‖₂ with S such that the largest
A_i is small in it: any S gives a bound, and a good one gives it soon.

Two facts save work. Where all A_i have one block triangular form, up to the order of rows, ρ̂ is the
largest of their diagonal blocks'. And ρ̂ is that of the convex hull of the A_i: of all x⁺ = A(h) x
with A affine in h, it is that of the two ends.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import components

Array = NDArray[np.float64]
"""Here of q matrices, (q, p, p)."""

NEAR = 1e-3
"""How near the bounds come to one another, relative, if they can."""
MOST_PRODUCTS, WORK = 10_000, 1e8
"""That are looked at, of each block; the same times the cube of its order."""
LARGEST = 40
"""The order of a block up to which this is affordable."""
HUGE = 1e10
"""The size of entries from which products of many matrices would not be numbers any more."""
CROOKED = 1e8
"""The condition of an S from which what it makes small is rounding."""
ROUNDING = 1e-10
"""By which a longer order must be better than a shorter one, relative."""
SHARPNESS, ITERATIONS = (30.0, 200.0), 150
"""Of the smooth maximum of norms that S makes small, one after the other; of the search for S."""


@dataclass(frozen=True, slots=True)
class JointRadius:
    """Bounds on a joint spectral radius."""

    lower: float
    upper: float
    order: tuple[int, ...]
    """The product that attains the lower bound, repeated: numbers of matrices, the first first."""


def joint_spectral_radius(
    matrices: Sequence[NDArray[Any]], near: float = NEAR
) -> JointRadius | None:
    """Return bounds on the joint spectral radius of real or complex matrices, each (p, p).

    None where they have a block of more than `LARGEST` rows in common.
    """
    given = np.stack(matrices)
    if not np.isfinite(given).all():
        return JointRadius(np.inf, np.inf, (0,))
    size = float(np.abs(given).max())
    if size > HUGE:  # products would overflow
        scaled = joint_spectral_radius(list(given / size), near)
        return scaled and JointRadius(scaled.lower * size, scaled.upper * size, scaled.order)
    if np.iscomplexobj(given):
        given = np.block([[given.real, -given.imag], [given.imag, given.real]])
    blocks = list(_blocks(given))
    if max(block.shape[1] for block in blocks) > LARGEST:
        return None
    whole = JointRadius(0.0, 0.0, (0,))
    for block in sorted(blocks, key=lambda block: block.shape[1]):
        found = _search(_shrunk(block), whole, near)
        whole = JointRadius(found.lower, max(whole.upper, found.upper), found.order)
    return whole


def _blocks(matrices: Array) -> Iterator[Array]:
    """Yield the diagonal blocks of the finest block triangular form that all matrices have."""
    for rows in components(np.any(matrices != 0, axis=0)):
        yield matrices[:, rows[:, None], rows]


def _search(matrices: Array, known: JointRadius, near: float) -> JointRadius:
    """Return bounds; of the lower one, the larger of this and of what is known of other blocks.

    Below the latter nothing is looked for, so that the upper one may be no lower either.
    """
    lower, upper, best = known.lower, np.inf, known.order
    most = min(MOST_PRODUCTS, WORK / matrices.shape[1] ** 3)
    orders: list[tuple[int, ...]] = [(i,) for i in range(len(matrices))]
    products, looked = matrices, 0
    proven = np.full(len(matrices), np.inf)
    while True:
        each = 1 / len(orders[0])
        radii = np.abs(np.linalg.eigvals(products)).max(axis=1)
        for row in np.argsort(-radii):
            if radii[row] ** each <= lower * (1 + ROUNDING):
                break
            sure = _surely(products[row]) ** each
            if sure > lower * (1 + ROUNDING):
                lower, best = sure, orders[row]
        proven = np.minimum(proven, np.linalg.norm(products, 2, axis=(1, 2)) ** each)
        enough = lower * (1 + near)
        upper = min(upper, max(enough, float(proven.max())))
        going = np.flatnonzero(proven > enough)
        looked += len(products)
        if not len(going) or looked + len(going) * len(matrices) > most:
            return JointRadius(lower, upper, best)
        products = np.concatenate([matrix @ products[going] for matrix in matrices])
        orders = [(*orders[row], i) for i in range(len(matrices)) for row in going]
        proven = np.tile(proven[going], len(matrices))


def _surely(product: NDArray[np.float64]) -> float:
    """Return what ρ is at least, for all that rounding may have done to the eigenvalue.

    Of a product that vanishes, or has many eigenvalues that are alike, rounding makes large ones.
    """
    from scipy import linalg  # noqa: PLC0415, as in `_shrunk`

    found, left, right = linalg.eig(product, left=True, right=True)
    top = int(np.abs(found).argmax())
    angle = abs(np.vdot(left[:, top], right[:, top]))
    error = 10 * len(product) * np.finfo(float).eps * np.linalg.norm(product)
    return max(float(abs(found[top])) - float(error / max(angle, error)), 0.0)


def _shrunk(matrices: Array) -> Array:
    """Return S⁻¹ A_i S for an S in which the largest 2-norm is small, as far as one is found."""
    from scipy.optimize import minimize  # noqa: PLC0415, 0.2 s that most checks need not wait for

    p = matrices.shape[1]
    scale = float(np.linalg.norm(matrices, 2, axis=(1, 2)).max())
    if p == 1 or not scale:
        return matrices
    units = matrices / scale

    def largest(entries: Array, sharpness: float) -> tuple[float, Array]:
        """Return ln Σ exp(s ‖S⁻¹ A_i S‖₂)/s and its derivative by S: dσ = u' d(S⁻¹ A S) v."""
        S = entries.reshape(p, p)
        back = np.linalg.pinv(S)
        U, sizes, V = np.linalg.svd(back @ units @ S)
        u, v, norms = U[:, :, 0], V[:, 0], sizes[:, 0]
        weights = np.exp(sharpness * (norms - norms.max()))
        total = float(weights.sum())
        w = u @ back
        ahead = np.einsum("i,ij,ijk,il->kl", weights, w, units, v)
        behind = np.einsum("i,ij,ik->jk", weights * norms, w, u)
        return float(norms.max()) + np.log(total) / sharpness, ((ahead - behind) / total).ravel()

    entries = np.eye(p).ravel()
    for sharpness in SHARPNESS:
        some = {"maxiter": ITERATIONS}
        entries = minimize(largest, entries, (sharpness,), "L-BFGS-B", jac=True, options=some).x
    S = entries.reshape(p, p)
    if not np.linalg.cond(S) < CROOKED:
        return matrices
    return np.asarray(np.linalg.solve(S, matrices @ S), np.float64)
