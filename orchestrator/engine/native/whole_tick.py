"""All that a tick does but for the bus, by `tick.c`: plants, records, disagreement, jump.

The oracle is `orchestrator.engine.worker`, to the same bits. An algorithm whose jump is not known
there jumps by itself, and plants that native code does not step are stepped as ever.
"""

from ctypes import Structure, addressof, byref, c_double, c_int, c_size_t, c_void_p
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import ESTIMATE
from nrs_cosim.bus.validation import Records, Wire
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.dcea2 import SecondOrder
from nrs_cosim.estimator_agents.pd_like import PdLike
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.engine.native.tick import NativeDisagreements, TickCalls, state_of
from nrs_cosim.plant_fmu.fleet import Fleet
from nrs_cosim.plant_fmu.fmi.instances import NativeSteps
from nrs_cosim.plant_fmu.fmi.native.batch_calls import StepAddresses
from nrs_cosim.plant_fmu.plants import Plants

_FIRST, _SECOND = range(2)
_FINE, _UNBOUNDED, _NOT_HELD, _NOT_STEPPED, _NOT_FINITE = range(5)
"""As tick.c has them."""
_ARRAYS = (
    *("q", "qd", "tau", "position", "velocity", "left_position", "left_velocity"),
    *("sent_position", "sent_velocity", "apart", "veer", "robots", "samples"),
)


class _Group(Structure):
    _fields_ = (
        ("steps", StepAddresses),
        ("n", c_size_t),
        ("width", c_size_t),
        *((name, c_void_p) for name in ("rows", "reference", "outputs")),
    )


class _Tick(Structure):
    _fields_ = (
        *((name, c_void_p) for name in ("state", "groups")),
        *((name, c_size_t) for name in ("n_groups", "at_group", "at_instance")),
        *((name, c_void_p) for name in _ARRAYS),
        *((name, c_size_t) for name in ("size", "at_k", "at_time", "at_position", "at_velocity")),
        *((name, c_double) for name in ("time", "alpha", "beta")),
        ("form", c_int),
    )


def known_form(algorithm: Algorithm) -> tuple[int, float, float] | None:
    """Return by which form, and with which gains, an algorithm jumps; None where by no known."""
    # A subclass may jump otherwise.
    if type(algorithm) is FirstOrder:
        return _FIRST, algorithm.alpha, algorithm.beta
    if type(algorithm) is SecondOrder:
        return _SECOND, algorithm.alpha, algorithm.beta
    if type(algorithm) is PdLike:
        return _SECOND, algorithm.alpha, 1.0
    return None


class WholeTick:
    """The arrays of a worker's robots, of which tick.c has the addresses."""

    def __init__(
        self,
        native: TickCalls,
        wire: Wire,
        agents: Agents,
        plants: Plants,
        disagreements: NativeDisagreements,
        limit: float,
        most: int,
    ) -> None:
        """Have room for the states of `most` outputs."""
        self._advance, self._receive, self._jump = native.advance, native.receive, native.jump
        self._agents, self._plants = agents, plants
        rows, m = plants.q.shape
        own = {name: np.empty((rows, m)) for name in ("position", "velocity")}
        left, found = ({name: np.empty((rows, m)) for name in own} for _ in range(2))
        self._own, self._left = own, left
        self.states: Records = wire.states.blank(np.tile(agents.robots, most))
        """(most · robots,), an output after the other."""
        self.samples: NDArray[np.uint8] = np.zeros(4 + rows * wire.samples.size, np.uint8)
        """A batch of samples: k, and (robots,) records."""
        records = self.samples[4:]
        records[:] = wire.samples.blank(agents.robots).view(np.uint8)
        robots = agents.robots.astype(np.int64)
        state = state_of(wire.states, self.states, plants, limit)
        steps = plants.native() if isinstance(plants, Fleet) else "they are not stepped here"
        self.steps_why = steps if isinstance(steps, str) else ""
        """Why native code does not step the plants along with all else, if so."""
        self._steps = [] if isinstance(steps, str) else [of for _, of in steps]
        groups = [] if isinstance(steps, str) else [_group(*one) for one in steps]
        self._form = known_form(agents.algorithm)
        form, alpha, beta = self._form or (_FIRST, 0.0, 0.0)
        sent = disagreements.sent
        motion = [plants.q, plants.qd, plants.tau, *own.values(), *left.values()]
        exchanged = [*(sent[name] for name in ESTIMATE), *found.values()]
        arrays: list[NDArray[Any]] = [*motion, *exchanged, robots, records]
        place = {name: wire.samples.dtype.fields[name][1] for name in ("k", "time_ns", *ESTIMATE)}  # type: ignore[index]
        self._groups = (_Group * len(groups))(*(one for one, _ in groups))
        self._tick = _Tick(
            addressof(state),
            addressof(self._groups),
            len(groups),
            0,
            0,
            *(array.ctypes.data for array in arrays),
            wire.samples.size,
            *place.values(),
            0.0,
            alpha,
            beta,
            form,
        )
        self._kept = state, groups, arrays, disagreements
        self._given = byref(self._tick)
        self._edges = [tuple(map(byref, pair)) for pair in disagreements.edges]

    def take_up(self) -> None:
        """Go on from what agents are at right after a t_k."""
        self._take_estimates()
        if self._steps:
            assert isinstance(self._plants, Fleet)
            self._tick.time = self._plants.time

    def left(self) -> Values:
        """Return the left limits of the last `advance`."""
        return Values({name: values.copy() for name, values in self._left.items()})

    def hand_over(self) -> None:
        """Let agents and plants be at what was reached right after t_k."""
        self._agents.state = Values({name: values.copy() for name, values in self._own.items()})
        if self._steps:
            assert isinstance(self._plants, Fleet)
            self._plants.reached(self._tick.time)

    def advance(
        self,
        start: float,
        step: float,
        since: float,
        k: int,
        t: int,
        slot: int,
        *,
        holds: bool,
        sends: bool,
    ) -> bool:
        """Advance the plants from a time by a step to t, ns, a time after the last t_k, all in s.

        First they are given new references, if so. The states become the slot's records; when it
        `sends`, samples are made. Return whether all is bounded; `StepError` as plants.
        """
        if not self._steps:
            if holds:
                self._plants.hold(*self._own.values())
            self._plants.advance(start, step)
        how = self._advance(self._given, holds, start, step, since, k, t, slot, sends)
        if how > _UNBOUNDED:
            of = self._steps[self._tick.at_group]
            held, stepped = how > _NOT_HELD, how > _NOT_STEPPED
            of.raise_for(self._tick.at_instance, start, step, held=held, stepped=stepped)
        return how == _FINE

    def jump(self, k: int, target: bytes, robots: bytes) -> None:
        """Let the agents receive the target's record of t_k and the batch of all others', and jump.

        `AlgorithmError` as `Agents.jump`.
        """
        if self._form:
            edges = self._edges[self._agents.exchange_at(k)]
            if self._jump(self._given, target, robots, *edges):
                return
        else:
            self._receive(self._given, target, robots)
        self._agents.jump(k, self.left())
        self._take_estimates()

    def _take_estimates(self) -> None:
        for name, values in self._own.items():
            values[:] = self._agents.state[name]


def _group(rows: NDArray[np.intp], of: NativeSteps) -> tuple[_Group, Any]:
    """Return some robots' plants as tick.c knows them, and what the addresses are of."""
    kept = rows.astype(np.int64), of.given[1], of.read[1]
    width = kept[1].shape[1]
    return _Group(of.addresses, len(rows), width, *(array.ctypes.data for array in kept)), (
        kept,
        of,
    )
