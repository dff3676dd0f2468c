"""Property P3 of the bundled models: λ_m ≤ ‖M‖₂ ≤ λ_M, ‖C(η, q)‖₂ ≤ λ_c ‖η‖₂, ‖G‖₂ ≤ λ_g.

With the links' angles to the horizontal φ = L q, an arm has M = Lᵀ A L + diag(J) with
A_ij = a_ij cos(φ_i − φ_j), C(η, q) = Lᵀ [a_ij sin(φ_i − φ_j) (L η)_j] L, for which Ṁ − 2 C is skew
symmetric (P2), and G = g Lᵀ [s_i cos φ_i]; a and s are in the readme of `n_link_arm`, and all a_ij
and s_i ≥ 0. Hence

- λ_M: x'Mx is largest over φ where each cos(φ_i − φ_j) is the sign of y_i y_j, y = L x: where each
  link points the same way as the first or back. The largest of the 2^(n−1) such postures counts;
  with the same J everywhere it is the arm stretched out, and ‖Lᵀ a L‖₂ + max J is never too little;
- λ_m: with two links M is affine in one cosine, and λ_min concave in it: least at its ends. With
  more, λ_min ≥ that of diag(J), for what is added is not negative;
- λ_c: with two links sin = 1 and C = a_12 [[η_2, η_1 + η_2], [−η_1, 0]]. With t = η_2/η_1, ‖C‖₂²
  is stationary at t = 0, where it is a_12², and at the roots of t³ + t² − 3 t − 1, where it is
  a_12² (t² + 2 t − 1)/((t − 1)(t² + 1)): most at the largest. With more links, at most
  ‖Lᵀ [a_ij √j]_{i≠j} L‖₂, for |L η|_j ≤ √j ‖η‖₂ and norms of nonnegative matrices grow with them;
- λ_g: G is convex in the cosines and nothing in it is negative: the arm stretched out level.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from itertools import product
from math import sqrt
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.plant_fmu.bundled.declaration import declaration

Array = NDArray[np.float64]

PATTERNS = 8
"""Links up to which all postures that may be the heaviest are tried."""


@dataclass(frozen=True, slots=True)
class Bounds:
    """P3 of one robot, over all postures, and viscous drag: ‖F‖₂ ≤ λ_f in M q̈ + C q̇ + F q̇ + G."""

    lambda_m: float
    """kg m²"""
    lambda_M: float  # noqa: N815, the paper's symbol
    """kg m²"""
    lambda_c: float
    """kg m²"""
    lambda_g: float
    """N m"""
    lambda_f: float
    """N m s"""
    source: str
    """How they were found."""
    states: int | None = None
    """Of how many states they are the worst, where it was sampled; the truth may be worse."""
    mobility: tuple[float, ...] = ()
    """The largest (M⁻¹)_ii seen of each joint, 1/(kg m²) or 1/kg; none where it is not known."""


def bounds_of(model: str, parameters: Mapping[str, Any], m: int) -> Bounds | None:
    """Return P3 of a bundled model with some of its parameters set.

    None for other models, and for parameters that the model itself refuses.
    """
    if model not in {"two_link_arm", "n_link_arm", "planar_robot"}:
        return None
    given = {v.name: v.start for v in declaration(model).of_kind("parameter")}
    size = m if model == "n_link_arm" else 1
    try:
        p = {
            name: np.broadcast_to(np.asarray(parameters.get(name, start), float), size)
            for name, start in given.items()
        }
    except (TypeError, ValueError, OverflowError):
        return None
    if model == "planar_robot":
        mass, drag = float(p["m"][0]), float(p["d"][0])
        return Bounds(mass, mass, 0.0, 0.0, drag, "exact", mobility=(1 / mass,) * m if mass else ())
    if model == "two_link_arm":
        masses, lengths, drives = (np.append(p[f"{k}1"], p[f"{k}2"]) for k in "mrJ")
        numbers = (masses, lengths, lengths, np.zeros(2), drives)
    else:
        numbers = (p["m"], p["r"], p["c"], p["I"], p["J"])
    return _known_arm(tuple(tuple(one.tolist()) for one in numbers), float(p["g"][0]))


@lru_cache(maxsize=64)
def _known_arm(numbers: tuple[tuple[float, ...], ...], g: float) -> Bounds | None:
    """Return P3 of an arm, found once: the robots of a study's points have much the same."""
    mass, r, c, I, J = map(np.array, numbers)  # noqa: E741
    return arm(mass, r, c, I, J, g)


def arm(mass: Array, r: Array, c: Array, I: Array, J: Array, g: float) -> Bounds | None:  # noqa: E741
    """Return P3 of an arm with links (n,), in SI; None where one of its numbers is negative."""
    n = len(mass)
    if min(map(np.min, (mass, r, c, I, J))) < 0:
        return None
    a, s = moments(mass, r, c, I)
    L = np.tril(np.ones((n, n)))
    stretched = L.T @ a @ L
    weight = float(np.linalg.norm(abs(g) * L.T @ s))
    largest = float(np.linalg.eigvalsh(stretched)[-1] + J.max())
    mobility: tuple[float, ...] = ()
    if n <= PATTERNS:
        postures = [L.T @ (a * np.outer(u, u)) @ L + np.diag(J) for u in _straight(n)]
        sizes = np.linalg.eigvalsh(np.array(postures))
        largest = float(sizes[:, -1].max())
        if sizes[:, 0].min() > 0:
            inverses = np.linalg.inv(np.array(postures))
            mobility = tuple(inverses.diagonal(axis1=1, axis2=2).max(axis=0).tolist())
    if n == 1:
        return Bounds(largest, largest, 0.0, weight, 0.0, "exact", mobility=mobility)
    if n == 2:
        least = float(sizes[:, 0].min())
        turning = _turning(float(a[0, 1]))
        return Bounds(least, largest, turning, weight, 0.0, "exact", mobility=mobility)
    apart = a - np.diag(np.diag(a))
    turning = float(np.linalg.norm(L.T @ (apart * np.sqrt(np.arange(1, n + 1))) @ L, 2))
    source = "safe, lambda_g exact"
    return Bounds(float(J.min()), largest, turning, weight, 0.0, source, mobility=mobility)


def _straight(n: int) -> Iterator[Array]:
    """Yield the postures in which each link points as the first does, 1, or back, −1."""
    for signs in product((1.0, -1.0), repeat=n - 1):
        yield np.array([1.0, *signs])


def moments(mass: Array, r: Array, c: Array, I: Array) -> tuple[Array, Array]:  # noqa: E741
    """Return a, (n, n), and s, (n,), of an arm's energies (the opening comment of `model.c`)."""
    beyond = np.append(np.cumsum(mass[::-1])[::-1][1:], 0.0)
    s = mass * c + r * beyond
    a = np.triu(np.outer(r, s), 1)
    a += a.T + np.diag(I + mass * c**2 + r**2 * beyond)
    return a, s


def _turning(coupling: float) -> float:
    """Return sup ‖C(η, q)‖₂ over |η| = 1 of two links that are coupled by a_12."""
    t = float(np.roots([1, 1, -3, -1]).real.max())
    return coupling * sqrt((t**2 + 2 * t - 1) / ((t - 1) * (t**2 + 1)))
