"""Between sampling times an estimate moves by ε̇ = υ, υ̇ = 0 (paper, equation 3.3).

Hence on (t_k, t_{k+1}] it is known in closed form: ε(t) = ε(t_k⁺) + (t − t_k) υ(t_k⁺).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Estimate:
    """ε and υ: arrays of one shape, (m,) for one robot or (n, m) for many."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]

    def after(self, seconds: float) -> "Estimate":
        """Return the estimate a time later, with no sampling time in between."""
        return Estimate(self.position + seconds * self.velocity, self.velocity)


@dataclass(frozen=True, slots=True, eq=False)
class Disagreement:
    """Σ_j w_ij/ϖ_i (ε_j − ε_i) and Σ_j w_ij/ϖ_i (υ_j − υ_i), of the same shape as an estimate."""

    position: NDArray[np.float64]
    velocity: NDArray[np.float64]
