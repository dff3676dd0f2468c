"""An algorithm declares what an agent keeps, sends and receives, and says what it does at t_k.

At each sampling time, in this order, and on arrays with a row a robot:

    flow      the state at t_k⁻ from that at t_{k−1}⁺
    observe   the target, by the robots that are pinned to it
    send      a message, and by whom
    receive   the samples of the in-neighbours; the state at t_k⁺

Each is a pure function, so that a run is the same to the last bit however it is spread. Most
algorithms need one method alone, `jump`: it is given the estimate and the disagreement.
"""

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import ESTIMATE, Fields
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.estimate import Disagreement, Estimate
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Array, Values

Missing = Literal["hold", "drop"]
"""What an agent does without a sample of an in-neighbour."""
Arrivals = Literal["newest", "every"]
"""Which of the samples that arrive at t_k over one link an agent receives."""

POLICIES: tuple[Missing, ...] = get_args(Missing)

Spectrum = NDArray[np.complex128]
Spectra = tuple[Spectrum, ...]
"""Of D; of the positions' and of the velocities' D where these are two."""
Mask = NDArray[np.bool_]


class Algorithm:
    """A distributed estimator: a frozen dataclass, whose fields are its parameters.

    A subclass has a `jump`, or a `receive` of its own. Arrays that it is given must not be written.

    Example:
        >>> from dataclasses import dataclass
        >>> import nrs_cosim as nrs
        >>> @dataclass(frozen=True)
        ... class Averaging(nrs.Algorithm):
        ...     alpha: float
        ...
        ...     def jump(self, estimate, disagreement):
        ...         position = estimate.position + self.alpha * disagreement.position
        ...         return nrs.Estimate(position, estimate.velocity)
    """

    __slots__ = ()

    STATE: ClassVar[Fields] = ESTIMATE
    """What an agent keeps. Position and velocity are what its robot follows."""
    SENT: ClassVar[Fields] = ESTIMATE
    """What it sends; of fields that it keeps, what it keeps, unless `send` is its own."""
    LINK: ClassVar[Fields] = {}
    """What it keeps of each in-neighbour; `receive` then returns these too."""
    MISSING: ClassVar[tuple[Missing, ...]] = POLICIES
    """What it may do without a sample of an in-neighbour; the first unless a scenario asks."""
    ARRIVALS: ClassVar[Arrivals] = "newest"
    """The newest of the samples that arrive at t_k over a link, or every one, oldest first."""
    TRIGGERED: ClassVar[bool] = False
    """Whether `send` decides who sends; else all robots do, at every t_k."""
    SEPARATE_GRAPHS: ClassVar[bool] = False
    """Whether positions and velocities may be received over digraphs of their own."""

    def flow(self, x: Values, dt: float) -> Values:
        """Return the state a time dt, s, after t_k⁺, with no sampling time in between."""
        return x.replace(position=x.position + dt * x.velocity)

    def measure(self, now: Now, target: Values) -> Values:  # noqa: ARG002
        """Return what pinned robots measure of the target: (rows, *shape), or *shape for all.

        `target` has the fields of its sample: each field of SENT that has a truth is that, each
        other one its initial value.
        """
        return target

    def observe(self, now: Now, x: Values, measured: Values, pinned: Mask) -> Values:  # noqa: ARG002
        """Return the state after a look at the target, which the `pinned` rows have at t_k."""
        return x

    def send(self, now: Now, x: Values) -> tuple[Values, Values, Mask | None]:  # noqa: ARG002
        """Return the state afterwards, the messages, and who sends, (rows,): None for all."""
        return x, Values({name: x[name] for name in self.SENT}), None

    def receive(
        self,
        now: Now,  # noqa: ARG002
        x: Values,
        received: Received,
    ) -> Values | tuple[Values, Values]:
        """Return the state at t_k⁺; with link fields, those of each edge, (E, …), beside it."""
        return jumped(self, x, received)

    def jump(self, estimate: Estimate, disagreement: Disagreement) -> Estimate:
        """Return ε_i(t_k⁺), υ_i(t_k⁺) from the left limits and the disagreement, at t_k.

        It works alike on one robot, (m,), and on many, (n, m).
        """
        raise NotImplementedError  # a class without it has a `receive` of its own, or is refused

    def modes(self, spectrum: Spectrum, h: float) -> Spectrum:  # noqa: ARG002
        """Return the eigenvalues of the error's recursion, one axis of m, from those of D.

        None at all, an empty array, where it is not linear or nobody derived them. A class with
        `SEPARATE_GRAPHS` takes a third argument, which is given where velocities have their own D:
        the spectrum of that.
        """
        return np.zeros(0, np.complex128)

    def conditions(self, spectrum: Spectrum, h: float) -> Sequence[Condition]:  # noqa: ARG002
        """Return the stability conditions for the eigenvalues s_i of D and the period h, s.

        A third argument as for `modes`.
        """
        return ()

    def demands(self, h: float, gamma_1: float, gamma_2: float) -> Sequence[Condition]:  # noqa: ARG002
        """Return conditions on the period h, s, and on the largest |υ_0| and |a_0| (A1)."""
        return ()

    def nominal(self) -> "tuple[Algorithm, Mapping[str, float]] | None":
        """Return the algorithm that it is but for errors of what is received; None for no such.

        They are of the samples of robots, the most at any time, by field. The bounds of that
        algorithm then hold, with what such errors add.
        """
        return None

    def periods_between(self, position: Array, velocity: Array, h: float) -> Array | None:  # noqa: ARG002
        """Return how many sampling periods h lie at least between two samples of each robot, (n,).

        In steady state its estimate jumps by `position` and `velocity` at most, (n,) each. None
        where nobody knows, or where all robots send at every t_k.
        """
        return None

    def stays_within(self, liars: int) -> bool:  # noqa: ARG002
        """Return whether a robot that receives from so many liars stays between the others.

        That is, whether at t_k⁺ its position and velocity are between the least and the largest of
        its own, of the honest in-neighbours' and of the target's; they move in a line in between.
        """
        return False

    def graph_conditions(
        self,
        topology: Topology,  # noqa: ARG002
        byzantine: frozenset[int],  # noqa: ARG002
    ) -> Sequence[Condition]:
        """Return conditions on the interaction graph, and on where `byzantine` robots are in it.

        As many for every digraph, by the same names.
        """
        return ()


def name_of(algorithm: Algorithm) -> str:
    """Return what an algorithm is called in errors."""
    return str(getattr(algorithm, "name", type(algorithm).__name__))


def modes(algorithm: Algorithm, spectra: Spectra, h: float) -> Spectrum:
    """Return an algorithm's modes on its digraph, or on its two; none where it has none."""
    if not overrides(class_of(algorithm), "modes"):
        return np.zeros(0, np.complex128)
    modes_of: Any = algorithm.modes
    found: Spectrum = modes_of(spectra[0], h, *spectra[1:])
    return found


def conditions(algorithm: Algorithm, spectra: Spectra, h: float) -> Sequence[Condition]:
    """Return an algorithm's conditions on its digraph, or on its two; none where it has none."""
    if not overrides(class_of(algorithm), "conditions"):
        return ()
    conditions_of: Any = algorithm.conditions
    found: Sequence[Condition] = conditions_of(spectra[0], h, *spectra[1:])
    return found


def nominal_of(algorithm: Algorithm) -> Algorithm:
    """Return the algorithm that one is but for errors of what is received: mostly itself."""
    nominal = algorithm.nominal()
    return nominal[0] if nominal else algorithm


def jumped(algorithm: Algorithm, x: Values, received: Received) -> Values:
    """Return the state after the `jump` of an algorithm that needs no more than that."""
    found = Disagreement(
        received.disagreement("position", x.position),
        received.disagreement("velocity", x.velocity),
    )
    return jumped_by(algorithm, x, found)


def jumped_by(algorithm: Algorithm, x: Values, disagreement: Disagreement) -> Values:
    """Return the state after the `jump` of an algorithm, by a disagreement."""
    after = algorithm.jump(Estimate(x.position, x.velocity), disagreement)
    return x.replace(position=after.position, velocity=after.velocity)


def class_of(algorithm: Algorithm) -> type[Algorithm]:
    """Return an algorithm's own class, also where another stands before it."""
    own: Algorithm = getattr(algorithm, "own", algorithm)
    return type(own)


def overrides(kind: type[Algorithm], method: str) -> bool:
    """Return whether a class has a method of its own."""
    return getattr(kind, method) is not getattr(Algorithm, method)


def jumps(algorithm: Algorithm) -> bool:
    """Return whether `jump` says all that an algorithm does."""
    kind = class_of(algorithm)
    methods = ("flow", "measure", "observe", "send", "receive")
    return kind.STATE == ESTIMATE and not any(overrides(kind, method) for method in methods)
