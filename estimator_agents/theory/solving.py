"""A x = b for sparse A; not numbers where A is singular, so that nothing is promised of it.

The factors of a large digraph without structure are dense: GMRES, which needs A's own entries
alone, is asked first, and believed where it leaves a 10⁻¹⁰ of b at most: less may be beyond
rounding, for x is larger than b by as much as 1/(1 − ρ).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import gmres, splu

LARGE, LEFT = 4000, 1e-10
"""Unknowns from which GMRES is asked; ‖b − A x‖₂ / ‖b‖₂ that it must come to."""
RESTART, ROUNDS = 60, 5


def solve(A: sparse.sparray, b: NDArray[Any]) -> NDArray[Any]:
    """Return x, (p,), of A, (p, p), and b, (p,)."""
    x: NDArray[Any]
    if len(b) >= LARGE:
        x, missed = gmres(A.tocsr(), b, rtol=LEFT, restart=RESTART, maxiter=ROUNDS)
        if not missed:
            return x
    try:
        x = splu(A.tocsc()).solve(b)
    except RuntimeError:  # SuperLU's only word for an exact zero on the diagonal
        return np.full(len(b), np.nan)
    return x
