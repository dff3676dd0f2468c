"""The recorder writes what workers say, a closed tick at a time, in the very bytes that travelled.

Tick k closes with the samples of t_k and all that the workers told of it: their states of
(t_{k−1}, t_k], link events, what agents keep and measured, checkpoints. It is counted by worker: a
batch is accepted only when it holds all that is expected of its worker. What is rejected is counted
by its reason and passed over; what is said twice is kept once.
"""

from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from os import PathLike
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.keys import EVERYONE, RECORDS, SAMPLES, TARGET, kind_of
from nrs_cosim.bus.messages import HEADER
from nrs_cosim.bus.topics import Topics
from nrs_cosim.bus.transport import Message
from nrs_cosim.bus.validation import Records, RejectedError, Tick, TickBlock, Wire
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import Message as Recorded
from nrs_cosim.recordings.mcap.ordering import columns_of
from nrs_cosim.recordings.mcap.reader import Reader

_NONE = 0
"""No channel has this number."""


@dataclass(slots=True)
class _Open:
    """A tick that is not closed yet, by worker."""

    samples: dict[str, Records] = field(default_factory=dict)
    ticks: dict[str, Tick] = field(default_factory=dict)


class TickWriter(Protocol):
    """What ticks are written to; see `recordings.mcap.writer.Writer`."""

    path: str | PathLike[str]

    @property
    def numbers(self) -> Mapping[str, int]:
        """Of each topic its channel."""

    def put(self, tick: Sequence[Columns]) -> None:
        """Write a tick."""

    def flush(self) -> None:
        """Put all ticks so far where `path` is read."""


class Recorder:
    """Writes what the workers of a run say.

    `rejected` counts batches by reason; `repeated` what was said again, as a worker
    does that was restored.
    """

    def __init__(
        self,
        writer: TickWriter,
        wire: Wire,
        n: int,
        keep: int,
        take_states: Callable[[Sequence[Records]], None] = lambda _states: None,
        take_link_events: Callable[[Records], None] = lambda _events: None,
    ) -> None:
        """Write what n robots say over a wire; the samples of `keep` closed ticks stay at hand.

        `take_states` is given the states of each tick, or of some, that is written, and
        `take_link_events` what each worker tells of its links, where it tells any.

        A batch with a message on a topic that has no channel is refused.
        """
        self.messages = 0
        self.sent = 0
        """How many of them are samples of robots."""
        self.rejected: Counter[str] = Counter()
        self.repeated = 0
        self.taken = 0
        """How many batches were accepted and new."""
        self.closed = -1
        """The last tick that was written."""
        self.checkpoints: dict[int, tuple[int, bytes]] = {}
        """Of each robot the last that is recorded: its tick and its message."""
        self._writer, self._wire, self._keep = writer, wire, keep
        self._take_states, self._take_link_events = take_states, take_link_events
        self._open: defaultdict[int, _Open] = defaultdict(_Open)
        self._block: TickBlock | None = None
        """Ticks that are not closed yet."""
        self._past: dict[int, list[Records]] = {}
        self._reader: Reader | None = None
        self._read_until = -1
        self._workers = frozenset(wire.assignment) - {TARGET}
        self._topics = topics = Topics.of_run(n)
        self._sample_topics = topics.all_of("sample", range(n + 1))

        def on(kind: str) -> NDArray[np.uint16]:
            """Return the channels of a kind, by node."""
            found = np.full(n + 1, _NONE, np.uint16)
            for topic, nodes in topics.each(kind, range(n + 1)):
                found[nodes.start : nodes.stop] = writer.numbers.get(topic, _NONE)
            return found

        self._samples_on, self._states_on = on("sample"), on("state")
        self._of_agents_on = {kind: on(kind) for kind in ("agent_state", "measurement")}
        self._link_events_on, self._checkpoints_on = on("link_event"), on("checkpoint")

    def take(self, message: Message) -> None:
        """Take what was put on a key; what is no batch of the run is refused and counted.

        Raises `BusError` when a worker says a tick again, and not in the same words.
        """
        kind, _, worker = message.key.partition("/")
        if kind not in {SAMPLES, RECORDS}:
            self.rejected["key"] += 1
            return
        try:
            if kind == SAMPLES:
                new = self._is_new(worker, self._wire.unpack_each(worker, message.payload))
            elif block := self._wire.own_block(worker, message.payload):
                new = block.first > self.closed and block is not self._block
                self._block = block if new else self._block
            else:
                new = self._is_new_tick(worker, *self._wire.unpack_tick(worker, message.payload))
        except RejectedError as error:
            self.rejected[str(error)] += 1
            return
        self.taken += new
        self.repeated += not new

    def is_whole(self, k: int) -> bool:
        """Return whether nothing of tick k is missing."""
        if self._block and self._block.first <= k <= self._block.last:
            return True
        tick, workers = self._open[k], len(self._workers)
        return len(tick.ticks) == workers and (not k or len(tick.samples) == workers + 1)

    def missing(self, k: int) -> dict[str, list[str]]:
        """Return what tick k lacks: of each worker, which kinds."""
        if k <= self.closed:
            return {}
        tick = self._open[k]
        lacks = {worker: [RECORDS] for worker in self._workers - tick.ticks.keys()}
        for worker in (self._workers | {TARGET}) - tick.samples.keys() if k else ():
            lacks.setdefault(worker, []).append(SAMPLES)
        return lacks

    def last_received(self, worker: str) -> int:
        """Return the last tick of which a worker's samples came."""
        received = (k for k, tick in self._open.items() if worker in tick.samples)
        return max(received, default=self.closed)

    def close(self, k: int) -> None:
        """Write tick k, of which nothing is missing, and what came in one with it."""
        if self._block and self._block.first == k:
            self._close_block(self._block)
            return
        tick = self._open.pop(k)
        parts = [_columns(self._samples_on, records) for records in tick.samples.values()]
        checkpoints: list[bytes] = []
        for of_worker in tick.ticks.values():
            parts.append(_columns(self._states_on, of_worker.states))
            for kind, records in of_worker.of_agents.items():
                parts.append(_columns(self._of_agents_on[kind], records))
            if len(of_worker.link_events):
                parts.append(_columns(self._link_events_on, of_worker.link_events))
                self._take_link_events(of_worker.link_events)
            checkpoints += of_worker.checkpoints
        if checkpoints:
            messages = [self._checkpoint(message) for message in checkpoints]
            parts.append(columns_of(messages, self._writer.numbers))
        self._put(k, parts, list(tick.samples.values()), checkpoints)
        self._take_states([of_worker.states for of_worker in tick.ticks.values()])

    def _close_block(self, block: TickBlock) -> None:
        parts = [
            _columns(self._samples_on, block.samples),
            _columns(self._states_on, block.states),
        ]
        self._writer.put(parts)
        self._take_states([block.states])
        self.messages += len(block.samples) + len(block.states)
        self.sent += int(np.count_nonzero(block.samples["robot"]))
        self.closed, self._block = block.last, None
        for k in range(block.first, block.last + 1):
            self._open.pop(k, None)
            self._past.pop(k - self._keep, None)

    def copy(self, k: int, batch: list[Recorded]) -> None:
        """Write tick k as another recording of the same run has it."""
        by_kind: defaultdict[str, list[bytes]] = defaultdict(list)
        for _, topic, _, data in batch:
            by_kind[kind_of(topic)].append(data)
        samples = self._wire.samples.decode(by_kind["sample"])
        part = columns_of(batch, self._writer.numbers)
        self._put(k, [part], [samples], by_kind["checkpoint"])
        self._take_states([self._wire.states.decode(by_kind["state"])])
        if met := by_kind["link_event"]:
            self._take_link_events(self._wire.link_events.decode(met))

    def samples(self, since: int, until: int) -> Iterator[tuple[int, Records, str]]:
        """Yield the samples of the ticks since … until that are known: k, records, worker.

        A closed tick is whole, and its worker is `EVERYONE`. What is no more at hand is read from
        the recording.
        """
        closed = range(since, min(until, self.closed) + 1)
        if any(k not in self._past for k in closed):
            yield from self._read(since, min(until, self.closed))
        else:
            for k in range(since, until + 1):
                if self._past.get(k):
                    yield k, np.concatenate(self._past[k]), EVERYONE
        for k, tick in self._open.items():
            if since <= k <= until:
                yield from ((k, records, worker) for worker, records in tick.samples.items())

    def end(self) -> None:
        """Let go of what was read again."""
        if self._reader:
            self._reader.close()

    def _read(self, since: int, until: int) -> Iterator[tuple[int, Records, str]]:
        if not self._reader or self._read_until < until:
            self.end()
            self._writer.flush()
            self._reader, self._read_until = Reader(self._writer.path), self.closed
        found: defaultdict[int, list[bytes]] = defaultdict(list)
        times = self._wire.times.t(since), self._wire.times.t(until) + 1
        for batch in self._reader.batches(self._sample_topics, *times):
            for _, _, k, data in batch:
                found[k].append(data)
        for k, samples in found.items():
            yield k, self._wire.samples.decode(samples), EVERYONE

    def _put(
        self, k: int, tick: list[Columns], samples: list[Records], checkpoints: Sequence[bytes]
    ) -> None:
        self._writer.put(tick)
        self.messages += sum(len(part.channel) for part in tick)
        self.sent += sum(int(np.count_nonzero(records["robot"])) for records in samples)
        self.closed = k
        for message in checkpoints:
            self.checkpoints[HEADER.unpack_from(message)[0]] = k, message
        self._past[k] = samples
        self._past.pop(k - self._keep, None)

    def _checkpoint(self, message: bytes) -> Recorded:
        robot, k, time_ns = HEADER.unpack_from(message)
        return time_ns, self._topics.of("checkpoint", robot), k, message

    def _is_new(self, worker: str, each: Iterable[tuple[int, Records]]) -> bool:
        """Keep a worker's samples of some ticks; return whether any of these was not known yet."""
        new = False
        for k, samples in each:
            if k > self.closed:
                of_tick = self._open[k].samples
                new |= worker not in of_tick
                first = of_tick.setdefault(worker, samples)
                same = first is samples or first.tobytes() == samples.tobytes()
                self._expect_same(k, worker, same)
        return new

    def _is_new_tick(self, worker: str, k: int, tick: Tick) -> bool:
        """Keep what else a worker told of a tick; return whether that was not known yet."""
        if not self._has_channels(tick):
            raise RejectedError("topic")
        if k <= self.closed:
            return False
        ticks = self._open[k].ticks
        new = worker not in ticks
        known = ticks.setdefault(worker, tick)
        self._expect_same(k, worker, known is tick or _same(known, tick))
        return new

    def _has_channels(self, tick: Tick) -> bool:
        """Return whether what not every run has is of this one."""
        if not (tick.checkpoints or len(tick.link_events)):
            return True
        robots = [HEADER.unpack_from(message)[0] for message in tick.checkpoints]
        events, checkpoints = (
            self._link_events_on[tick.link_events["robot"]],
            self._checkpoints_on[robots],
        )
        return bool(events.all() and checkpoints.all())

    @staticmethod
    def _expect_same(k: int, worker: str, same: bool) -> None:
        if not same:
            raise BusError(
                f"tick {k}: worker {worker} sent it twice with other contents: its FMUs do not go "
                "the same way again from the same state, or another party that has the run's "
                "secret put a message in its name"
            )


def _same(one: Tick, other: Tick) -> bool:
    """Return whether two say the same of what enters the digest beside samples."""
    kept = [{kind: of.tobytes() for kind, of in tick.of_agents.items()} for tick in (one, other)]
    return one.states.tobytes() == other.states.tobytes() and kept[0] == kept[1]


def _columns(channels: NDArray[np.uint16], records: Records) -> Columns:
    """Return messages of one kind as they are; channels are by node."""
    starts, stops = _places(records.dtype.itemsize, len(records))
    data, on = records.view(np.uint8).data, channels[records["robot"]]
    return Columns(data, on, records["k"], records["time_ns"], starts, stops)


@lru_cache(maxsize=16)
def _places(size: int, count: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return where messages of one size begin and end that follow one another."""
    stops = np.arange(size, size * count + 1, size)
    return stops - size, stops
