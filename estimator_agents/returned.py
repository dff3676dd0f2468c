"""What the methods of an algorithm return has the declared shapes, and is numbers.

Else a plant would be blamed for it, or nothing would. The line names the method and its place.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import Cause
from nrs_cosim.estimator_agents.algorithm import Algorithm, class_of, name_of, overrides
from nrs_cosim.estimator_agents.errors import AlgorithmError, written_at
from nrs_cosim.estimator_agents.values import Array

Returned = tuple[Mapping[str, Array], Mapping[str, Array], NDArray[np.integer]]
"""What a method returned by field, what has the right shapes, and the robots of the rows."""


def expect_returned(algorithm: Algorithm, k: int, method: str, of: Sequence[Returned]) -> None:
    """Raise `AlgorithmError` for another shape, and for what is no number at tick k.

    It names the first robot's that is wrong, so that it is the same robot however they are spread
    over workers.
    """
    wrong = []
    for fields, like, robots in of:
        for name, values in fields.items():
            expected = (len(robots), *like[name].shape[1:])
            if values.shape != expected:
                raise wrong_return(
                    algorithm,
                    method,
                    f"returned a {name} of shape {values.shape}, expected {expected}",
                )
            if not (finite := np.isfinite(values)).all():
                places = np.argwhere(~finite)
                first = places[robots[places[:, 0]].argmin()]
                wrong.append((int(robots[first[0]]), name, values[tuple(first)]))
    if wrong:
        robot, name, value = min(wrong, key=lambda one: one[0])
        raise wrong_return(
            algorithm,
            method,
            f"returned a {name} of {value} for robot {robot} at tick {k}",
            Cause("algorithm", tick=k, robot=robot, quantity=name),
        )


def wrong_return(
    algorithm: Algorithm, method: str, what: str, cause: Cause | None = None
) -> AlgorithmError:
    """Return the error of what a method does, with its place in the class."""
    kind = class_of(algorithm)
    if method == "receive" and not overrides(kind, method):
        method = "jump"
    line = f"algorithm {name_of(algorithm)}: {method} {what}"
    return AlgorithmError(f"{line}{written_at(getattr(kind, method))}", cause)
