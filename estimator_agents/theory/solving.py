"""A x = b for a matrix A; not numbers where A is singular, so that nothing is proven of it.

Where the second half of x depends on nothing of the first, as velocities on no positions, it is
found first, and each half by itself. The factors of a large digraph without structure are dense:
GMRES, which needs A's own entries alone, is asked first, and believed where it leaves a 10⁻¹⁰ of b
at most: less may be beyond rounding, for x is larger than b by as much as 1/(1 − ρ).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.matrices import Matrix

LARGE, LEFT = 4000, 1e-10
"""Unknowns from which GMRES is asked; ‖b − A x‖₂ / ‖b‖₂ that it must come to."""
RESTART, ROUNDS = 60, 5


def solve(A: Matrix, b: NDArray[Any]) -> NDArray[Any]:
    """Return x, (p,), of A, (p, p), and b, (p,)."""
    x: NDArray[Any]
    if isinstance(A, np.ndarray):
        try:
            x = np.linalg.solve(A, b)
        except np.linalg.LinAlgError:  # an exact zero on the diagonal
            return np.full(len(b), np.nan)
        return x
    from scipy import sparse  # noqa: PLC0415, as in `bus.matrices`
    from scipy.sparse.linalg import gmres, splu  # noqa: PLC0415, as above

    half = len(b) // 2
    if len(b) >= LARGE:
        rows = sparse.csr_array(A)
        if not rows[half:, :half].count_nonzero():
            last = solve(rows[half:, half:], b[half:])
            first = solve(rows[:half, :half], b[:half] - rows[:half, half:] @ last)
            return np.concatenate([first, last])
        x, missed = gmres(rows, b, rtol=LEFT, restart=RESTART, maxiter=ROUNDS)
        if not missed:
            return x
    try:
        x = splu(A.tocsc()).solve(b)
    except RuntimeError:  # SuperLU's only word for an exact zero on the diagonal
        return np.full(len(b), np.nan)
    return x
