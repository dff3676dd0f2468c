"""An algorithm of another package may be wrong in any way; each is one line, which says where.

The line names the algorithm, how it was called, the exception, and the place in the package's code.
"""

import traceback
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import EntryPoint
from math import inf
from typing import Any, Self, TypeVar

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.bus.text import quoted
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import (
    Algorithm,
    Mask,
    Spectrum,
    jumped,
    overrides,
)
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.declarations import DECLARED, wrong_declarations
from nrs_cosim.estimator_agents.errors import AlgorithmError, written_at
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Array, Values

T = TypeVar("T")


def loaded(entry: EntryPoint) -> type[Algorithm]:
    """Return the class of an entry point; `AlgorithmError` where that is no class of algorithms."""
    what = f"{entry.name} from {quoted(entry.value)}"
    kind: Any = _done(what, None, entry.load)
    if not isinstance(kind, type) or not issubclass(kind, Algorithm):
        raise AlgorithmError(
            f"algorithm.name: {what} is no subclass of nrs_cosim.Algorithm{written_at(kind)}"
        )
    for wrong in wrong_declarations(kind):
        raise AlgorithmError(f"algorithm.name: {entry.name}: {wrong}{written_at(kind)}")
    return kind


@dataclass(frozen=True, slots=True)
class ThirdParty(Algorithm):
    """An algorithm of another package: asked as any other, and its faults are `AlgorithmError`."""

    name: str
    own: Algorithm
    """The algorithm itself."""

    @classmethod
    def built(cls, entry: EntryPoint, /, **parameters: Any) -> Self:
        """Return an entry point's algorithm with its parameters."""
        kind = loaded(entry)
        given = f"{entry.name}({', '.join(parameters)})"
        own = _done(given, kind, lambda: kind(**parameters))
        declared = {name: getattr(kind, name) for name in DECLARED}
        with_declared: type[Self] = type(cls.__name__, (cls,), {**declared, "__slots__": ()})
        return with_declared(entry.name, own)

    def flow(self, x: Values, dt: float) -> Values:
        """Return the state a time later."""
        return self._asked(
            "flow", "x, dt", lambda: _as_declared(self.own.flow(x.guarded(), dt), x, "state")
        )

    def measure(self, now: Now, target: Values) -> Values:
        """Return what pinned robots measure."""

        def act() -> Values:
            found = _named(self.own.measure(now, target.guarded()), target, "measurement")
            for name, value in found.items():
                whole = (len(now.robots), *target[name].shape)
                if value.shape not in {whole, (1, *whole[1:]), whole[1:]}:
                    raise ValueError(
                        f"expected a {name} of shape {whole}, or {whole[1:]} for all alike, got "
                        f"{value.shape}"
                    )
            return found

        return self._asked("measure", "now, target", act)

    def observe(self, now: Now, x: Values, measured: Values, pinned: Mask) -> Values:
        """Return the state after a look at the target."""

        def act() -> Values:
            after = self.own.observe(now, x.guarded(), measured.guarded(), pinned)
            return _as_declared(after, x, "state")

        return self._asked("observe", "now, x, measured, pinned", act)

    def send(self, now: Now, x: Values) -> tuple[Values, Values, Mask | None]:
        """Return the state, the messages, and who sends."""
        return self._asked("send", "now, x", lambda: self._sent(self.own.send(now, x.guarded()), x))

    def receive(self, now: Now, x: Values, received: Received) -> Values | tuple[Values, Values]:
        """Return the state at t_k⁺, and the link fields where there are any."""
        if not overrides(type(self.own), "receive"):
            return jumped(self, x, received)

        def act() -> Values | tuple[Values, Values]:
            after = self.own.receive(now, x.guarded(), received.guarded())
            if not self.LINK:
                return _as_declared(after, x, "state")
            if not isinstance(after, tuple) or len(after) != 2:
                raise TypeError("expected the state and the link fields, for LINK declares some")
            state, links = after
            links = _as_declared(links, received.links, "link field")
            return _as_declared(state, x, "state"), links

        return self._asked("receive", "now, x, received", act)

    def jump(self, estimate: Estimate, disagreement: Disagreement) -> Estimate:
        """Return the estimate right after t_k, of the same shape."""
        return self._asked(
            "jump",
            "estimate, disagreement",
            lambda: _alike(self.own.jump(estimate, disagreement), estimate),
        )

    def modes(self, spectrum: Spectrum, h: float, *velocity: Spectrum) -> Spectrum:
        """Return the eigenvalues of the error's recursion."""
        of: Any = self.own.modes
        return self._asked(
            "modes",
            "spectrum, h" + ", velocity" * len(velocity),
            lambda: np.asarray(of(spectrum, h, *velocity), complex),
        )

    def conditions(self, spectrum: Spectrum, h: float, *velocity: Spectrum) -> Sequence[Condition]:
        """Return the stability conditions."""
        of: Any = self.own.conditions
        return self._asked(
            "conditions",
            "spectrum, h" + ", velocity" * len(velocity),
            lambda: _conditions(of(spectrum, h, *velocity)),
        )

    def demands(self, h: float, gamma_1: float, gamma_2: float) -> Sequence[Condition]:
        """Return conditions on the target's motion."""
        return self._asked(
            "demands",
            "h, gamma_1, gamma_2",
            lambda: _conditions(self.own.demands(h, gamma_1, gamma_2)),
        )

    def nominal(self) -> tuple[Algorithm, Mapping[str, float]] | None:
        """Return the algorithm that it is but for errors of what is received."""
        return self._asked("nominal", "", lambda: _nominal(self.own.nominal()))

    def periods_between(self, position: Array, velocity: Array, h: float) -> Array | None:
        """Return how many sampling periods lie at least between two samples of each robot."""

        def act() -> Array | None:
            found = self.own.periods_between(position, velocity, h)
            return found if found is None else np.broadcast_to(found, position.shape).astype(float)

        return self._asked("periods_between", "position, velocity, h", act)

    def stays_within(self, liars: int) -> bool:
        """Return whether a robot that receives from so many liars stays between the others."""
        return self._asked("stays_within", "liars", lambda: bool(self.own.stays_within(liars)))

    def graph_conditions(
        self, topology: Topology, byzantine: frozenset[int]
    ) -> Sequence[Condition]:
        """Return conditions on who receives from whom."""
        return self._asked(
            "graph_conditions",
            "topology, byzantine",
            lambda: _conditions(self.own.graph_conditions(topology, byzantine)),
        )

    def _sent(self, given: Any, x: Values) -> tuple[Values, Values, Mask | None]:
        if not isinstance(given, tuple) or len(given) != 3:
            raise TypeError("expected the state, the messages, and who sends (None for all)")
        state, messages, who = given
        rows = len(x.position)
        if who is not None:
            who = np.asarray(who)
            if who.shape != (rows,) or who.dtype != bool:
                raise ValueError(
                    f"expected of who sends {rows} truths, got {who.dtype} {who.shape}"
                )
        return _as_declared(state, x, "state"), _named(messages, self.SENT, "message"), who

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
    return written_at(source)


def _named(given: Any, fields: Iterable[str], what: str) -> Values:
    """Return values that have exactly some fields."""
    if not isinstance(given, Values):
        raise TypeError(f"expected the {what} as Values, got {type(given).__name__}")
    for name in fields:
        if name not in given:
            raise TypeError(f"expected the {what} to have a {name}; it has {', '.join(given)}")
    for name in given:
        if name not in fields:
            raise TypeError(f"expected no {name} in the {what}; it has {', '.join(fields)}")
    for name, value in given.items():
        # What is computed of an array without axes is none: it is a number of NumPy's.
        is_array = isinstance(value, np.ndarray | np.float64)
        if not is_array or value.dtype != np.float64:
            kind = getattr(value, "dtype", type(value).__name__)
            raise TypeError(f"expected a {name} of doubles in the {what}, got {kind}")
    return Values({name: np.asarray(given[name]) for name in fields})


def _as_declared(given: Any, like: Values, what: str) -> Values:
    """Return values that have the fields and shapes of others."""
    values = _named(given, like, what)
    for name, value in values.items():
        if value.shape != like[name].shape:
            raise ValueError(
                f"expected a {name} of shape {like[name].shape}, as it was given, got {value.shape}"
            )
    return values


def _alike(after: Any, before: Estimate) -> Estimate:
    shape = before.position.shape
    if not isinstance(after, Estimate):
        raise TypeError(f"expected an Estimate, got {type(after).__name__}")
    for name in ("position", "velocity"):
        if np.shape(getattr(after, name)) != shape:
            got = np.shape(getattr(after, name))
            raise ValueError(f"expected a {name} of shape {shape}, as it was given, got {got}")
    return after


def _nominal(found: Any) -> tuple[Algorithm, Mapping[str, float]] | None:
    if found is None:
        return None
    algorithm, off = found
    if not isinstance(algorithm, Algorithm):
        raise TypeError(f"expected an Algorithm, got {type(algorithm).__name__}")
    for name in algorithm.SENT:
        if not 0 <= off[name] < inf:
            raise ValueError(f"expected a {name} of at least 0, got {off[name]}")
    return algorithm, off


def _conditions(found: Any) -> Sequence[Condition]:
    for condition in found:
        if not isinstance(condition, Condition):
            raise TypeError(f"expected each to be a Condition, got {quoted(condition)}")
    return tuple(found)
