"""How long the beginning lasts: the first tick k from which any error has fallen to a share of it.

Without the target's part x(t_{1+k}) = A^k x(t_1), so that it is the k at which ‖A^k‖∞, the largest
row sum of |A^k|, comes down to the share. ρ^k says that of the asymptote alone: in a path of
robots A is defective, and nothing falls at the end of it before the news is there.
Where A ≥ 0 the norm is max A^k 1, a vector's; of few robots A^k is made by squares.
"""

import numpy as np

from nrs_cosim.bus.matrices import Matrix, as_array, nonzeros
from nrs_cosim.estimator_agents.theory.recursion import Array

DENSE = 500
"""The order of A up to which its powers are made."""
WORK = 3e8
"""Multiplications that a vector's powers may take."""
FAR = 40
"""Squares: no more than 2^40 ticks are looked at."""


def ticks_until(A: Matrix, share: float) -> int | None:
    """Return the k at which ‖A^k‖∞ comes to a share < 1; None where that is not found.

    A is one matrix for all ticks, with ρ < 1, and the norm is above the share at k − 1.
    """
    if A.shape[0] <= DENSE:
        return _by_squares(as_array(A), share)
    return _by_ones(A, share) if A.min() >= 0 else None


def _by_squares(A: Array, share: float) -> int | None:
    """Double k until the norm is small, then take back what is not needed, from large to small."""
    squares = [A]
    while not _norm(squares[-1]) <= share:
        if len(squares) > FAR or not np.isfinite(squares[-1]).all():
            return None
        squares.append(squares[-1] @ squares[-1])
    k, power = 0, np.eye(len(A))
    for i in reversed(range(len(squares) - 1)):
        longer = squares[i] @ power
        if _norm(longer) > share:
            k, power = k + 2**i, longer
    return k + 1


def _by_ones(A: Matrix, share: float) -> int | None:
    x = np.ones(A.shape[0])
    for k in range(1, int(WORK / nonzeros(A)) + 1):
        x = A @ x
        if x.max() <= share:
            return k
    return None


def _norm(A: Array) -> float:
    return float(np.abs(A).sum(axis=1).max())
