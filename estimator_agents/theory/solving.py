"""A x = b for sparse A; not numbers where A is singular, so that nothing is promised of it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import splu


def solve(A: sparse.sparray, b: NDArray[Any]) -> NDArray[Any]:
    """Return x, (p,), of A, (p, p), and b, (p,)."""
    try:
        x: NDArray[Any] = splu(A.tocsc()).solve(b)
    except RuntimeError:  # SuperLU's only word for an exact zero on the diagonal
        return np.full(len(b), np.nan)
    return x
