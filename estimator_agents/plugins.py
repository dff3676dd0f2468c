"""An algorithm of another package may be wrong in any way; each is one line, which says where.

The line names the algorithm, how it was called, the exception, and the place in the package's code.
"""

import inspect
import traceback
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.bus.text import quoted
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate

T = TypeVar("T")
Spectrum = NDArray[np.complex128]


def loaded(entry: EntryPoint) -> Any:
    """Return the class of an entry point; `AlgorithmError` where it cannot be imported."""
    return _done(f"{entry.name} from {quoted(entry.value)}", None, entry.load)


@dataclass(frozen=True, slots=True)
class Foreign:
    """An algorithm that is asked as any other, and whose faults are `AlgorithmError`."""

    name: str
    own: Any
    """The algorithm itself."""

    @classmethod
    def built(cls, entry: EntryPoint, /, **parameters: Any) -> Self:
        """Return an entry point's algorithm with its parameters."""
        kind = loaded(entry)
        given = f"{entry.name}({', '.join(parameters)})"
        own = _done(given, kind, lambda: kind(**parameters))
        return cls(entry.name, own)

    def jump(self, estimate: Estimate, heard: Disagreement) -> Estimate:
        """Return the estimate right after t_k, of the same shape."""
        return self._asked(
            "jump", "estimate, heard", lambda: _alike(self.own.jump(estimate, heard), estimate)
        )

    def modes(self, spectrum: Spectrum, h: float, *velocity: Spectrum) -> Spectrum:
        """Return the eigenvalues of the error's recursion."""
        return self._asked(
            "modes",
            "spectrum, h" + ", velocity" * len(velocity),
            lambda: np.asarray(self.own.modes(spectrum, h, *velocity), complex),
        )

    def conditions(self, spectrum: Spectrum, h: float, *velocity: Spectrum) -> Sequence[Condition]:
        """Return the stability conditions."""
        return self._asked(
            "conditions",
            "spectrum, h" + ", velocity" * len(velocity),
            lambda: _conditions(self.own.conditions(spectrum, h, *velocity)),
        )

    def demands(self, h: float, gamma_1: float, gamma_2: float) -> Sequence[Condition]:
        """Return conditions on the target's motion; none where the algorithm has no `demands`."""
        if not hasattr(self.own, "demands"):
            return ()
        return self._asked(
            "demands",
            "h, gamma_1, gamma_2",
            lambda: _conditions(self.own.demands(h, gamma_1, gamma_2)),
        )

    def _asked(self, method: str, given: str, act: Callable[[], T]) -> T:
        kind = type(self.own)
        return _done(f"{self.name}.{method}({given})", getattr(kind, method, kind), act)


def _done(what: str, source: Any, act: Callable[[], T]) -> T:
    """Act; what goes wrong in it, which may be anything, is an `AlgorithmError`."""
    try:
        return act()
    except CosimError:
        raise
    except Exception as error:
        cause = " ".join(f"{type(error).__name__}: {error}".split())
        raise AlgorithmError(f"algorithm.name: {what}: {cause}{_place(error, source)}") from error


def _place(error: Exception, source: Any) -> str:
    """Return where in the package's code an error came up, or where what was called begins."""
    steps = [
        step
        for step in traceback.extract_tb(error.__traceback__)
        if step.filename != __file__ and not step.filename.startswith("<")
        if "importlib" not in step.filename
    ]
    for step in reversed(steps):
        if step.filename == steps[0].filename:
            return f", at {step.filename}:{step.lineno}"
    with suppress(OSError, TypeError):
        return f", at {inspect.getsourcefile(source)}:{inspect.getsourcelines(source)[1]}"
    return ""


def _alike(after: Any, before: Estimate) -> Estimate:
    shape = before.position.shape
    if not isinstance(after, Estimate):
        raise TypeError(f"expected an Estimate, got {type(after).__name__}")
    for name in ("position", "velocity"):
        if np.shape(getattr(after, name)) != shape:
            got = np.shape(getattr(after, name))
            raise ValueError(f"expected a {name} of shape {shape}, as it was given, got {got}")
    return after


def _conditions(found: Any) -> Sequence[Condition]:
    for condition in found:
        if not isinstance(condition, Condition):
            raise TypeError(f"expected each to be a Condition, got {quoted(condition)}")
    return tuple(found)
