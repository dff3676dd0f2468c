"""The growth of a matrix's powers (Gelfand): no eigenvalue is computed."""

import numpy as np


def growth(A: np.ndarray) -> float:
    """Return ‖A^k‖^(1/k) for k = 2^24, by squares that are scaled."""
    size = 0.0
    for doubling in range(24):
        most = np.abs(A).max()
        if not most:
            return 0.0
        size += np.log(most) / 2**doubling
        A = (A / most) @ (A / most)
    return float(np.exp(size + np.log(np.abs(A).max()) / 2**24)) if A.any() else 0.0
