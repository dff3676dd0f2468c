"""Whether the modes that an algorithm declares are those of its own code."""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.estimator_agents.algorithm import Algorithm, Spectrum, jumps, modes, name_of
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.theory.linear_step import linear_step
from nrs_cosim.estimator_agents.theory.recursion import linear_jump

TRIED = (0.0, 0.5, -0.9, 0.3 + 0.4j)
"""Eigenvalues of D that an algorithm's modes are looked at for."""
NEAR = 1e-9
"""Relative: how near they are to be."""


@np.errstate(all="ignore")
def expect_modes(algorithm: Algorithm, h: float) -> None:
    """Raise `AlgorithmError` where an algorithm's modes are not those of its own code.

    Of an eigenvalue s of D these are the eigenvalues of F (K + (s − 1) G) of its jump, or of what
    `linear_step` finds. Their sum and product are compared, which rounding does little to. One that
    gives none says nothing wrong, nor does one of whose code nothing is known.
    """
    blocks = _blocks(algorithm, h)
    if blocks is None:
        if jumps(algorithm) and len(modes(algorithm, (np.zeros(1, np.complex128),), h)):
            raise AlgorithmError(
                f"algorithm {name_of(algorithm)}: its jump is not linear, so that it has no modes; "
                "let modes return an empty array"
            )
        return
    for s, A in zip(TRIED, blocks, strict=True):
        given = modes(algorithm, (np.array([s], np.complex128),), h)
        size = np.abs(A).sum()
        if not len(given) or not np.isfinite(size ** len(A)):
            continue
        wrong = abs(given.sum() - A.trace()) > NEAR * size
        wrong |= abs(given.prod() - np.linalg.det(A)) > NEAR * size ** len(A)
        if len(given) != len(A) or wrong or not np.isfinite(given).all():
            raise AlgorithmError(
                f"algorithm {name_of(algorithm)}: modes of s = {s:g} at h = {h:g} s are "
                f"{_listed(given)}, but its {'jump' if jumps(algorithm) else 'code'} has "
                f"{_listed(np.linalg.eigvals(A))}"
            )


def _blocks(algorithm: Algorithm, h: float) -> Spectrum | None:
    """Return a matrix for each eigenvalue that is tried; None of what is not known to be linear."""
    spectrum = np.array(TRIED, np.complex128)
    if not jumps(algorithm):
        step = linear_step(algorithm, h)
        return None if step is None else step.blocks(spectrum)
    found = linear_jump(algorithm)
    if found is None:
        return None
    keep, gain = found
    flow = np.array([[1.0, h], [0.0, 1.0]], np.complex128)
    blocks: Spectrum = flow @ (keep + (spectrum - 1)[:, None, None] * gain)
    return blocks


def _listed(numbers: NDArray[np.complex128]) -> str:
    return " and ".join(f"{z.real:.6g}" if z.imag == 0 else f"{z:.6g}" for z in numbers)
