"""What a tick does for all robots by `tick.c`, to the same bits as NumPy, which is the oracle.

Where nothing can be compiled, or an algorithm is not of the form, NumPy does it.
"""

import sys
from collections.abc import Sequence
from ctypes import (
    CDLL,
    Structure,
    byref,
    c_bool,
    c_char_p,
    c_double,
    c_int,
    c_size_t,
    c_uint32,
    c_uint64,
    c_void_p,
)
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import ESTIMATE
from nrs_cosim.bus.messages import Codec
from nrs_cosim.bus.validation import Records
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.edges import Edges
from nrs_cosim.estimator_agents.estimate import Disagreement
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.plant_fmu.bundled.builder import build_library
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fmi.calls import Call, bind
from nrs_cosim.plant_fmu.plants import Plants

Array = NDArray[np.float64]
SOURCE = Path(__file__).with_suffix(".c")
_FIELDS = ("position", "velocity", "effort", "reference_position", "reference_velocity")


_ADVANCE = c_void_p, c_bool, *(c_double,) * 3, c_uint32, c_uint64, c_size_t, c_bool


class _Edges(Structure):
    kept: Any
    """What the addresses are of."""
    _fields_ = (
        ("rows", c_size_t),
        ("m", c_size_t),
        ("start", c_void_p),
        ("source", c_void_p),
        ("weight", c_void_p),
    )


class StateRecords(Structure):
    """Of what records are made, and how."""

    kept: Any
    """What the addresses are of."""
    _fields_ = (
        ("rows", c_size_t),
        ("m", c_size_t),
        ("limit", c_double),
        *((name, c_void_p) for name in ("q", "qd", "tau", "records")),
        *((name, c_size_t) for name in ("size", "at_k", "at_time")),
        ("at", c_size_t * len(_FIELDS)),
    )


class TickCalls(NamedTuple):
    """The functions of tick.c."""

    disagree: Call
    state: Call
    advance: Call
    receive: Call
    jump: Call


@cache
def load_tick() -> TickCalls | None:
    """Return the functions of tick.c; None where there is no compiler, of which plants tell."""
    if sys.byteorder != "little":
        return None
    try:
        dll = CDLL(str(build_library("tick", {SOURCE.name: SOURCE.read_bytes()})))
    except (FmuError, OSError):
        return None
    four, received = (c_void_p,) * 4, (c_void_p, c_char_p, c_char_p)
    return TickCalls(
        bind(dll, "disagree", *four, result=None),
        bind(dll, "state", *four[:3], c_uint32, c_uint64, result=c_bool),
        bind(dll, "advance", *_ADVANCE, result=c_int),
        bind(dll, "receive", *received, result=None),
        bind(dll, "jump", *received, c_void_p, c_void_p, result=c_bool),
    )


def state_of(codec: Codec, records: Records, plants: Plants, limit: float) -> StateRecords:
    """Return how records (outputs · robots,) are made of what plants are at."""
    place = {name: codec.dtype.fields[name][1] for name in ("k", "time_ns", *_FIELDS)}  # type: ignore[index]
    kept = plants.q, plants.qd, plants.tau, records
    found = StateRecords(
        *plants.q.shape,
        limit,
        *(array.ctypes.data for array in kept),
        codec.size,
        place["k"],
        place["time_ns"],
        (c_size_t * len(_FIELDS))(*(place[name] for name in _FIELDS)),
    )
    found.kept = kept
    return found


class NativeStates:
    """Looks at states, and makes records of them; see `Worker`, whose oracle NumPy is."""

    def __init__(
        self, native: TickCalls, codec: Codec, agents: Agents, plants: Plants, limit: float
    ) -> None:
        self._state, self._records = native.state, codec.blank(agents.robots)
        self._reference = [np.empty_like(plants.q) for _ in ESTIMATE]
        self._of = state_of(codec, self._records, plants, limit)
        self._given = byref(self._of), *(array.ctypes.data for array in self._reference)

    def records(self, k: int, t: int, reference: Values) -> Records | None:
        """Return the states of t, ns, as records; None where one is not within bounds."""
        for into, name in zip(self._reference, ESTIMATE, strict=True):
            into[:] = reference[name]
        return self._records.copy() if self._state(*self._given, k, t) else None


class NativeDisagreements:
    """Disagreements of robots; see `Agents.disagree_by`."""

    def __init__(
        self, native: TickCalls, exchanges: Sequence[tuple[Edges, Edges]], sent: Values
    ) -> None:
        self._disagree = native.disagree
        shape = len(exchanges[0][0].start), *sent.position.shape[1:]
        self._own, self._found = ([np.empty(shape) for _ in ESTIMATE] for _ in range(2))
        made = {edges: _edges(edges, shape[1]) for edges in set(chain(*exchanges))}
        self.sent = sent
        """What nodes sent last."""
        self.edges = [tuple(made[edges] for edges in pair) for pair in exchanges]
        """Of positions and of velocities, by exchange, as tick.c knows them."""
        self._given = [
            [
                (byref(made[edges]), *(array.ctypes.data for array in (sent[name], own, found)))
                for edges, name, own, found in zip(
                    pair, ESTIMATE, self._own, self._found, strict=True
                )
            ]
            for pair in exchanges
        ]

    def __call__(self, exchange: int, own: Values) -> Disagreement:
        """Return the disagreement with what was sent last, over the edges of an exchange."""
        for into, name, given in zip(self._own, ESTIMATE, self._given[exchange], strict=True):
            into[:] = own[name]
            self._disagree(*given)
        return Disagreement(*(found.copy() for found in self._found))


def _edges(edges: Edges, m: int) -> _Edges:
    start = np.append(edges.start, len(edges.source)).astype(np.int64)
    source, weight = edges.source.astype(np.int64), edges.weight[:, 0].copy()
    found = _Edges(len(edges.start), m, *(a.ctypes.data for a in (start, source, weight)))
    found.kept = start, source, weight
    return found
