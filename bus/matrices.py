"""The matrix of a digraph is dense for few robots, sparse for many: products and sums are the same.

SciPy takes longer to load than all that is computed of few robots: it is loaded for many alone.
"""

from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from scipy import sparse

Matrix: TypeAlias = "NDArray[Any] | sparse.csr_array"

FEW = 100
"""Robots up to which matrices are dense: computed with sooner than SciPy is loaded."""


def matrix_of(
    rows: NDArray[np.intp], columns: NDArray[np.intp], entries: NDArray[np.float64], n: int
) -> Matrix:
    """Return the matrix (n, n) of entries, each (E,) and given once, at rows and columns from 0."""
    if n <= FEW:
        dense = np.zeros((n, n))
        dense[rows, columns] = entries
        return dense
    from scipy import sparse  # noqa: PLC0415, see above

    return sparse.csr_array((entries, (rows, columns)), shape=(n, n))


def as_array(A: Matrix) -> NDArray[Any]:
    """Return a matrix (r, c) as an array (r, c)."""
    return A if isinstance(A, np.ndarray) else A.toarray()


def identity_like(A: Matrix) -> Matrix:
    """Return the identity (n, n) for A (n, n), and of its kind."""
    if isinstance(A, np.ndarray):
        return np.eye(len(A))
    from scipy import sparse  # noqa: PLC0415, see above

    return sparse.eye_array(A.shape[0], format="csr")


def kron(small: NDArray[np.float64], A: Matrix) -> Matrix:
    """Return small ⊗ A, (a r, b c), for an array (a, b) and a matrix (r, c), of A's kind."""
    if isinstance(A, np.ndarray):
        return np.kron(small, A)
    from scipy import sparse  # noqa: PLC0415, see above

    return sparse.csr_array(sparse.kron(small, A))


def nonzeros(A: Matrix) -> int:
    """Return how many entries of A (r, c) are not 0."""
    return int(np.count_nonzero(A)) if isinstance(A, np.ndarray) else int(A.nnz)


def components(A: Matrix) -> list[NDArray[np.intp]]:
    """Return the strongly connected components of the digraph with an edge where A is not 0.

    Each is an array (size,) of rows of A (n, n), ascending. In a dense matrix two rows are of one
    component where each reaches the other, by paths whose length doubles at each squaring.
    """
    if isinstance(A, np.ndarray) and len(A) <= 2 * FEW:
        reached = ((A != 0) | np.eye(len(A), dtype=bool)).astype(np.float64)
        for _ in range(len(A).bit_length()):
            # Doubles, for which products are quick; at most 1, for numbers of paths would overflow.
            reached = np.minimum(reached @ reached, 1.0)
        first = ((reached > 0) & (reached.T > 0)).argmax(axis=1)
        return [np.flatnonzero(first == row) for row in np.flatnonzero(first == np.arange(len(A)))]
    from scipy.sparse.csgraph import connected_components  # noqa: PLC0415, see above

    number, label = connected_components(A, connection="strong")
    order = np.argsort(label, kind="stable")
    return np.split(order, np.searchsorted(label[order], np.arange(1, number)))
