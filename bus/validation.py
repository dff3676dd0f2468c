"""What workers put on the wire, and what of it is accepted.

A worker puts two batches a tick: `samples/<worker>`, the samples of its robots at t_k, for the
other workers and the recorder; and `records/<worker>`, all else that is recorded of the tick: its
states of (t_{k−1}, t_k], its link events, what its agents keep right after t_k and measured at it,
its checkpoints.
Each batch is k and then whole messages as they will stand in the recording, signed. A batch is
accepted when it is signed for its key, comes from a worker that the run has, and holds exactly what
is expected of it: its robots, its times, finite numbers. Any other is rejected with the reason, and
never mixed in.

A wire of one process knows the bytes that it packed itself: those that come and are the very same,
of which nothing but the numbers could be wrong, are not taken apart again. On it several ticks may
be one batch, that of the first: the target's samples, and the states of a worker that is alone.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import isfinite
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.bus.keys import RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.messages import HEADER, Codec
from nrs_cosim.bus.signature import Signer

Records = NDArray[np.void]
Nodes = NDArray[np.integer]

_K = Struct("<I")
_KEPT = 8
"""Of how many of the target's batches a wire knows that it packed them."""
_WRONG = {"robot": "robot", "k": "tick", "time_ns": "time"}


class RejectedError(BusError):
    """A batch that is not accepted; the text says why, in few words and without its numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class Tick:
    """What a worker tells the recorder of one tick, beside its samples."""

    states: Records
    link_events: Records
    checkpoints: Sequence[bytes]
    """Messages, one a robot; none at most ticks."""
    of_agents: Mapping[str, Records] = field(default_factory=dict)
    """What agents keep right after t_k and measured at it, by kind as `Codecs.of_agents`; none of
    t_0."""


@dataclass(frozen=True, slots=True, eq=False)
class TickBlock:
    """Ticks that a worker which is alone did one after another, and tells at once."""

    first: int
    last: int
    states: Records
    samples: Records
    """That it received: its own and the target's."""


@dataclass(frozen=True, slots=True, eq=False)
class SampleBlock:
    """Samples of ticks that follow one another, of a worker that has one node."""

    samples: Records


def _nobody(_k: int) -> Nodes:
    return np.empty(0, np.int64)


class Wire:
    """Packs and unpacks the batches of one run."""

    def __init__(
        self,
        codecs: Codecs,
        times: Clock,
        assignment: Mapping[str, Nodes],
        signer: Signer,
        silent: Callable[[int], Nodes] = _nobody,
        *,
        measuring: Callable[[int], Nodes] = _nobody,
        triggered: bool = False,
        in_process: bool = False,
    ) -> None:
        """Know the run: which nodes each worker has, ascending, and who cannot send at a tick.

        Nodes are (n,) each, 0 for the target. `measuring` are those that measure the target at a
        tick. Where it is `triggered`, each robot that can send decides itself whether it does.
        `in_process` says that all who put on it have this very object, which signs nothing, and
        that a tick's states have been found finite.
        """
        self.samples, self.states = codecs.samples, codecs.states
        self.link_events, self.of_agents = codecs.link_events, codecs.of_agents
        self.assignment = dict(assignment)
        self.times = times
        self._signer, self._silent, self._triggered = signer, silent, triggered
        self._measuring = measuring
        self.none = self.link_events.blank(np.empty(0, np.int64))
        """No link events."""
        self._accepted_last: dict[str, tuple[bytes, tuple[int, Records]]] = {}
        """Of each worker the last samples, as they came and as what they are."""
        self._knows_own = in_process and not triggered
        self._own: defaultdict[tuple[str, str], dict[int, tuple[bytes, Any]]] = defaultdict(dict)
        """By kind and worker, and by k: what was packed, and as what it is accepted."""
        # At t_0 there is one output, and as many in each interval after it.
        most = max(len(times.outputs(0)), len(times.outputs(1)))
        self._expected_samples = {
            worker: self.samples.blank(nodes) for worker, nodes in assignment.items()
        }
        self._expected_of_agents = {
            worker: {kind: codec.blank(nodes) for kind, codec in self.of_agents.items()}
            for worker, nodes in assignment.items()
        }
        self._expected_states = {
            worker: self.states.blank(np.tile(nodes, most)) for worker, nodes in assignment.items()
        }

    def pack_samples(self, worker: str, k: int, records: Records) -> bytes:
        """Return the batch of a worker's samples (n,) of t_k."""
        payload = self._signer.sign(wire_key(SAMPLES, worker), _K.pack(k) + records.tobytes())
        if self._knows_own and len(records) == len(self.assignment[worker]):
            packed = np.frombuffer(payload, self.samples.dtype, offset=_K.size)
            # Whoever is silent has no place in a batch, and an algorithm may say any number.
            if not self._silent(k).size and _is_finite(self.samples, packed):
                self._keep(SAMPLES, worker, payload, (k, packed))
        return payload

    def pack_ahead(self, worker: str, records: Records) -> list[bytes]:
        """Return the batches of the samples (ticks,) of a worker that has one node.

        They are one where all who put have this very object; see `unpack_each`.
        """
        key, ks = wire_key(SAMPLES, worker), records["k"].tolist()
        if self._knows_own and not any(self._silent(k).size for k in ks):
            payload = _K.pack(ks[0]) + records.tobytes()
            packed = np.frombuffer(payload, records.dtype, offset=_K.size)
            if _is_finite(self.samples, packed):
                self._keep(SAMPLES, worker, payload, (ks[0], SampleBlock(packed)))
                return [payload]
        samples = zip(ks, records, strict=True)
        return [self._signer.sign(key, _K.pack(k) + record.tobytes()) for k, record in samples]

    def unpack_each(self, worker: str, payload: bytes) -> list[tuple[int, Records]]:
        """Return k and the samples of each tick of a worker's batch; see `unpack_samples`."""
        if (block := self.own_samples(worker, payload)) is not None:
            return [(k, block[row : row + 1]) for row, k in enumerate(block["k"].tolist())]
        return [self.unpack_samples(worker, payload)]

    def unpack_samples(self, worker: str, payload: bytes) -> tuple[int, Records]:
        """Return k and the samples (n,) that a worker put.

        `RejectedError` when they are not accepted. What two receive on one wire is judged once.
        """
        if (own := self._packed(SAMPLES, worker, payload)) and not isinstance(own[1], SampleBlock):
            own_samples: tuple[int, Records] = own
            return own_samples
        known, accepted = self._accepted_last.get(worker, (b"", None))
        if accepted and payload == known:
            return accepted
        data, nodes = self._open(SAMPLES, worker, payload)
        k = self._tick(data, 1)
        silent = self._silent(k)
        expected = self._expected_samples[worker]
        if silent.size:
            expected = expected[~np.isin(nodes, silent)]
        messages = data[_K.size :]
        if self._triggered and worker != TARGET:
            expected = self._of_senders(messages, expected)
        expected["k"], expected["time_ns"] = k, self.times.t(k)
        accepted = k, self._accepted(self.samples, messages, expected)
        self._accepted_last[worker] = payload, accepted
        return accepted

    def pack_tick(self, worker: str, k: int, tick: Tick) -> bytes:
        """Return the batch of all else that is recorded of a worker's tick."""
        parts = [tick.states.tobytes(), tick.link_events.tobytes()]
        of_agents = (tick.of_agents.get(kind) for kind in self.of_agents)
        parts += [b"" if records is None else records.tobytes() for records in of_agents]
        parts += tick.checkpoints
        payload = self._signer.sign(wire_key(RECORDS, worker), _K.pack(k) + joined(parts))
        if self._knows_own and not (tick.of_agents or len(tick.link_events) or tick.checkpoints):
            self._keep(RECORDS, worker, payload, (k, tick))
        return payload

    def pack_block(self, worker: str, block: TickBlock) -> bytes:
        """Return the batch of all else that is recorded of some ticks; see `own_block`."""
        payload = _K.pack(block.first) + joined([block.states.tobytes(), b""])
        self._keep(RECORDS, worker, payload, (block.first, block))
        return payload

    def own_block(self, worker: str, payload: bytes) -> TickBlock | None:
        """Return of which ticks this very wire packed a batch, if so: nobody else can say any."""
        own = self._packed(RECORDS, worker, payload)
        return own[1] if own and isinstance(own[1], TickBlock) else None

    def own_samples(self, worker: str, payload: bytes) -> Records | None:
        """Return the samples (ticks,) that this very wire packed as one batch, if so."""
        own = self._packed(SAMPLES, worker, payload)
        return own[1].samples if own and isinstance(own[1], SampleBlock) else None

    def unpack_tick(self, worker: str, payload: bytes) -> tuple[int, Tick]:
        """Return k and a worker's records of it; `RejectedError` when they are not accepted."""
        if (own := self._packed(RECORDS, worker, payload)) and isinstance(own[1], Tick):
            own_tick: tuple[int, Tick] = own
            return own_tick
        data, robots = self._open(RECORDS, worker, payload)
        k = self._tick(data, 0)
        parts = parted(data[_K.size :])
        if parts is None or len(parts) < 2 + len(self.of_agents):
            raise RejectedError("size")
        state_bytes, met, *rest = parts
        of_agents = self._of_agents(worker, k, rest)
        checkpoints = rest[len(self.of_agents) :]
        expected, outputs = self._expected_states[worker], self.times.outputs(k)
        expected = expected[: len(robots) * len(outputs)]
        expected["k"] = k
        expected["time_ns"].reshape(len(outputs), -1)[:] = np.array(outputs)[:, None]
        states = self._accepted(self.states, state_bytes, expected)
        events = self._decoded(self.link_events, met) if met else self.none
        if (events["k"] != k).any():
            raise RejectedError("tick")
        if len(events) and not np.isin(events["robot"], robots).all():
            raise RejectedError("robot")
        headers = [_header(checkpoint) for checkpoint in checkpoints]
        if checkpoints and [robot for robot, _, _ in headers] != robots.tolist():
            raise RejectedError("robot")
        if any(header[1:] != (k, self.times.t(k)) for header in headers):
            raise RejectedError("tick")
        return k, Tick(states, events, checkpoints, of_agents)

    def _keep(self, kind: str, worker: str, payload: bytes, accepted: tuple[int, Any]) -> None:
        own = self._own[kind, worker]
        own[accepted[0]] = payload, accepted
        if len(own) > (_KEPT if worker == TARGET else 2):
            del own[next(iter(own))]

    def _packed(self, kind: str, worker: str, payload: bytes) -> Any:
        """Return k and what was packed as these very bytes; None where nothing was."""
        own = self._own.get((kind, worker))
        if not own or len(payload) < _K.size:
            return None
        known, accepted = own.get(_K.unpack_from(payload)[0], (b"", None))
        return accepted if known == payload else None

    def _of_agents(self, worker: str, k: int, parts: Sequence[bytes]) -> dict[str, Records]:
        """Return what agents tell of t_k, by kind, from as many parts; there is nothing of t_0."""
        found = {}
        for (kind, codec), data in zip(self.of_agents.items(), parts, strict=False):
            expected = self._expected_of_agents[worker][kind]
            if not k:
                expected = expected[:0]
            elif kind == "measurement":
                expected = expected[np.isin(expected["robot"], self._measuring(k))]
            expected["k"], expected["time_ns"] = k, self.times.t(k)
            found[kind] = self._accepted(codec, data, expected)
        return found

    def _of_senders(self, messages: bytes, expected: Records) -> Records:
        """Return what is expected of the robots that a batch says have sent: ascending, each once.

        That the others have not is said too, by the signature of a batch that is without them.
        """
        if len(messages) % self.samples.size:
            raise RejectedError("size")
        senders = np.frombuffer(messages, self.samples.dtype)["robot"]
        rows = np.searchsorted(expected["robot"], senders)
        known = rows < len(expected)
        if (
            not known.all()
            or (expected["robot"][rows] != senders).any()
            or (np.diff(rows) < 1).any()
        ):
            raise RejectedError("robot")
        return expected[rows]

    def _open(self, kind: str, worker: str, payload: bytes) -> tuple[bytes, Nodes]:
        nodes = self.assignment.get(worker)
        if nodes is None:
            raise RejectedError("worker")
        # Before anything else of it is read: what nobody of the run has signed says nothing.
        data = self._signer.verify(wire_key(kind, worker), payload)
        if data is None:
            raise RejectedError("signature")
        return data, nodes

    def _tick(self, data: bytes, first: int) -> int:
        if len(data) < _K.size:
            raise RejectedError("size")
        k: int = _K.unpack_from(data)[0]
        if not first <= k <= self.times.ticks:
            raise RejectedError("tick")
        return k

    def _decoded(self, codec: Codec, data: bytes) -> Records:
        if len(data) % codec.size:
            raise RejectedError("size")
        try:
            return codec.parsed(data)
        except BusError:
            raise RejectedError("value") from None

    def _accepted(self, codec: Codec, data: bytes, expected: Records) -> Records:
        """Return messages as records if they are those expected, whatever finite numbers they hold.

        With the numbers that came, the expected messages must be the very bytes that came.
        """
        if len(data) != expected.nbytes:
            raise RejectedError("size")
        records = np.frombuffer(data, codec.dtype)
        for name in codec.kind.fields:
            expected[name] = records[name]
        if not _is_finite(codec, records):
            raise RejectedError("value")
        if expected.tobytes() != data:
            wrong = (why for name, why in _WRONG.items() if (records[name] != expected[name]).any())
            raise RejectedError(next(wrong, "form"))
        return records


def _is_finite(codec: Codec, records: Records) -> bool:
    # A sum is quick; one of many numbers may be infinite where none of them is.
    return all(
        isfinite(records[name].sum()) or bool(np.isfinite(records[name]).all())
        for name in codec.kind.fields
    )


def _header(message: bytes) -> tuple[int, int, int]:
    if len(message) < HEADER.size:
        raise RejectedError("size")
    robot, k, time_ns = HEADER.unpack_from(message)
    return robot, k, time_ns
