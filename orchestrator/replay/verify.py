"""A recording is run again on what it holds, and must come to the same bits.

Every agent starts from the scenario's estimates, receives the recorded samples and jumps; every
plant starts from the scenario's states and follows the references of its agent. What they say at
each tick is compared with what was recorded, message by message in total order. Without the plants,
the agents alone are: the robots' own q, q̇ and τ are then taken as recorded.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from itertools import count
from os import PathLike
from typing import Any, Literal, Never

import numpy as np

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import BusError, InputError
from nrs_cosim.bus.former_mathematics import former_mathematics
from nrs_cosim.bus.keys import EVERYONE, RECORDS, SAMPLES, kind_of, wire_key
from nrs_cosim.bus.memory_bus import MemoryBus, MemoryInbox
from nrs_cosim.bus.messages import Codec
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.text import shortened
from nrs_cosim.bus.topics import Topics
from nrs_cosim.bus.transport import Item, Message
from nrs_cosim.bus.validation import Records
from nrs_cosim.orchestrator.engine.lockstep import TargetNode
from nrs_cosim.orchestrator.engine.native.arranging import load_arranging
from nrs_cosim.orchestrator.engine.plants import Find, find_recorded
from nrs_cosim.orchestrator.engine.robots import Robots, wire_of
from nrs_cosim.orchestrator.engine.worker import ReceivedSamples
from nrs_cosim.orchestrator.replay.difference import (
    ABSENT,
    PRESENT,
    Difference,
    Pairs,
    difference_in,
    node_of,
)
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.plant_fmu.plants import Array
from nrs_cosim.recordings.channels import channels
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.columns import Columns, columns, on_any_of
from nrs_cosim.recordings.mcap.container import DamageError
from nrs_cosim.recordings.mcap.container import Message as Recorded
from nrs_cosim.recordings.mcap.digest import Digest, digest_differs
from nrs_cosim.recordings.mcap.ordering import ranks
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.ticks import ticks
from nrs_cosim.recordings.recorder import Recorder
from nrs_cosim.recordings.schemas import (
    KINDS,
    about,
    contents_of,
    declared_types,
    recorded_types,
)

HERE = "here"


@dataclass(frozen=True, slots=True)
class Verification:
    """What a replay came to."""

    ticks: int
    """The last one that was run again; -1 where there is none, since tick 0 is not here."""
    messages: int
    """How many are the same to the last bit, from the first on."""
    difference: Difference | None
    unseen: int = 0
    """How many more are here that could not be looked at, since a tick before them is missing."""
    missing: int | None = 0
    """How many the run had that are not here; None where it is not known how many."""
    checkpoints: int = 0
    """How many messages of these ticks are plants' checkpoints, which are not computed again."""
    at_end: str = ""
    """What the run stored at its end that does not come out again; empty where all does."""
    by_libraries: bool = False
    """Whether sin, cos and draws are those of NumPy, SciPy and the C library, as when recorded."""

    @property
    def status(self) -> Literal["identical", "differs", "unverified"]:
        """Identical only where all messages of the run were looked at, and are the same."""
        if self.difference or self.at_end:
            return "differs"
        return "identical" if self.unseen == 0 and self.missing == 0 else "unverified"

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {"status": self.status, **asdict(self)}


class RecordedPlants:
    """Plants that do what they did, one output time after the other; see `DrivenPlants`."""

    checkpointable = False
    kind, drive, why = "Recording", "as recorded", "the recording has what they did"

    def __init__(self, robots: Sequence[int], m: int, ticks: Iterator[Records]) -> None:
        """Be some robots' plants, ascending; `ticks` are the states of all robots, by tick."""
        self.q, self.qd, self.tau = np.zeros((3, len(robots), m))
        self._robots = np.asarray(robots)
        self._ticks = ticks
        self._coming: Iterator[Records] = iter(())
        self.advance(0.0, 0.0)

    def hold(self, *reference: Array) -> None:
        """Pass over a reference."""

    def advance(self, start: float, step: float) -> None:  # noqa: ARG002
        """Go to the next output time, if need be of the next tick, and no earlier."""
        states = next(self._coming, None)
        if states is None:
            self._coming = self._next_tick()
            states = next(self._coming)
        self.q[:], self.qd[:], self.tau[:] = (
            states[name] for name in ("position", "velocity", "effort")
        )

    def save(self) -> Never:
        """Refuse: recorded states are not checkpointable, and nobody asks them."""
        raise NotImplementedError  # a replay makes no checkpoints

    def restore(self, data: Sequence[bytes]) -> Never:
        """Refuse: recorded states are not checkpointable, and nobody asks them."""
        raise NotImplementedError  # a replay makes no checkpoints

    def _next_tick(self) -> Iterator[Records]:
        states = next(self._ticks)
        mine = np.sort(states[np.isin(states["robot"], self._robots)], order=["time_ns", "robot"])
        return iter(mine.reshape(-1, len(self._robots)))


class _Samples:
    """What the worker receives: the recorded samples."""

    patience = 0.0

    def __init__(self) -> None:
        self.now: Records

    def lack(self, k: int, missing: Sequence[str]) -> Iterable[ReceivedSamples]:  # noqa: ARG002
        """Return the recorded samples of tick k."""
        return [(k, self.now, EVERYONE)]

    def handle(self, item: Item) -> Iterable[ReceivedSamples]:  # noqa: ARG002
        """Pass over all else."""
        return ()


class _RunAgain:
    """What the run says when it is run again: of a tick, and the digest of all so far.

    A tick is arranged as a writer would, with the recording's channels, so that where all is the
    same its records are the recording's, byte by byte.
    """

    path: str | PathLike[str] = ""

    def __init__(self, codecs: Codecs, n: int, recorded: Mapping[int, str]) -> None:
        robots = range(1, n + 1)
        found = channels(codecs, n, robots, checkpoints=True, measuring=robots)
        shared = {topic: number for number, topic in recorded.items()}
        free = (number for number in count(1) if number not in recorded)
        of = {shared.get(channel.topic) or next(free): channel for channel in found}
        self.topics = {number: channel.topic for number, channel in of.items()}
        self.numbers = {topic: number for number, topic in self.topics.items()}
        self._said = on_any_of(_said(self.topics))
        self._digest = Digest({number: one.topic for number, one in of.items() if one.counted})
        self._arrange = load_arranging()(ranks(self.topics), self._digest)
        self._pairs = Pairs(recorded, self.topics)

    def flush(self) -> None:
        """Do nothing: nothing is written."""

    def put(self, tick: Sequence[Columns]) -> None:
        """Take what a tick says of the run, and forget the one before."""
        arranged = self._arrange([part.only(self._said[part.channel]) for part in tick])
        self._digest.take(arranged.stream)
        self._records = bytes(arranged.records.data)

    def tick(self) -> Columns:
        """Return the messages of the tick, in total order."""
        return columns(self._records, self.topics)

    def first_difference(self, recorded: Columns) -> int | None:
        """Return the first row that is not as recorded; None where there is none."""
        same = recorded.stretch() == self._records
        return None if same else self._pairs.first(recorded, self.tick())

    def difference_at(self, codecs: Mapping[str, Codec], recorded: Columns, row: int) -> Difference:
        """Return what is not as recorded of a row."""
        return difference_in(codecs, codecs, *self._pairs.at(recorded, self.tick(), row))

    def digest(self) -> str:
        """Return the digest of all ticks so far."""
        return self._digest.hexdigest()


def verify(reader: Reader, experiment: Experiment, *, plants: bool) -> Verification:
    """Run a recording again, with its plants or by the agents alone, up to the first difference.

    It ends before a tick that is missing: there is no going on without it. A recording that was
    made with libraries' mathematics is run with these.
    """
    former = about(reader).is_former
    with former_mathematics(former):
        # What was worked out of the experiment by now was by our own.
        found = _run_again(reader, replace(experiment) if former else experiment, plants=plants)
    return replace(found, by_libraries=former)


def _run_again(reader: Reader, experiment: Experiment, *, plants: bool) -> Verification:
    clock, n, m = experiment.clock, experiment.n, experiment.m
    if (first := next(ticks(reader), None)) is None:
        return Verification(-1, 0, None, _unseen(reader, clock, -1), _missing(reader))
    numbers, codecs = range(1, n + 1), expect_same_types(reader, experiment)
    topics = Topics.among(reader.topics.values(), n)
    if not plants and (absent := _absent_state(first.messages(reader.topics), clock, 0, topics)):
        return Verification(-1, 0, absent, _unseen(reader, clock, -1), _missing(reader))
    with ExitStack() as stack, np.errstate(all="ignore"):
        robots = (
            Robots.opened(stack, experiment, numbers, _finder(reader, experiment))
            if plants
            else Robots.driven_by(
                experiment, numbers, RecordedPlants(numbers, m, states_of(reader)), []
            )
        )
        bus = MemoryBus()
        ear = bus.listen(wire_key(SAMPLES, "*"), wire_key(RECORDS, "*"))
        wire = wire_of(experiment, {HERE: numbers}, Signer())
        target = TargetNode(bus, clock, wire, experiment.target)
        again, received = _RunAgain(experiment.codecs, n, reader.topics), _Samples()
        recorder = Recorder(again, wire, n, 0)
        worker = robots.worker(HERE, bus, MemoryInbox(), wire)
        steps = worker.run(-1, lambda _time: None, received)
        said = on_any_of(_said(reader.topics))
        sample = on_any_of(recorded_types(reader).channels["sample"])
        same, checkpoints, k = 0, 0, -1
        for k, tick in enumerate(ticks(reader)):
            recorded = tick.only(said[tick.channel])
            if not plants and (
                absent := _absent_state(recorded.messages(reader.topics), clock, k, topics)
            ):
                return Verification(
                    k - 1, same, absent, _unseen(reader, clock, k - 1), _missing(reader)
                )
            samples = recorded.only(sample[recorded.channel])
            received.now = _records(reader, wire.samples, samples)
            target.publish_until(k)
            next(steps)
            for item in ear.take():
                if isinstance(item, Message):
                    recorder.take(item)
            recorder.close(k)
            if (row := again.first_difference(recorded)) is not None:
                return Verification(k, same + row, again.difference_at(codecs, recorded, row))
            same += len(recorded.time)
            checkpoints += len(tick.time) - len(recorded.time)
    unseen, missing = _unseen(reader, clock, k), _missing(reader)
    if not (unseen or missing or reader.computed) and again.digest() != reader.digest:
        reader.damage.append(digest_differs(reader.digest_here))
        missing = None
    return Verification(k, same, None, unseen, missing, checkpoints)


def _absent_state(tick: list[Recorded], clock: Clock, k: int, topics: Topics) -> Difference | None:
    """Return the first state of tick k that is not there, without which its robot does nothing."""
    there = {(message[0], node_of(message)) for message in tick if kind_of(message[1]) == "state"}
    for time_ns in clock.outputs(k):
        for robot in range(1, topics.n + 1):
            if (time_ns, robot) not in there:
                topic, t = topics.of("state", robot), seconds(time_ns)
                return Difference(k, t, topic, robot, "message", ABSENT, PRESENT)
    return None


def expect_states(reader: Reader, clock: Clock, n: int) -> None:
    """Raise `UnreadableError` for a recording that lacks a state in a tick that it has."""
    topics = Topics.among(reader.topics.values(), n)
    for states in reader.columns(topics.all_of("state", range(1, n + 1))):
        ks = np.unique(states.sequence).tolist()
        times, counts = np.unique(states.time, return_counts=True)
        if times.tolist() == [t for k in ks for t in clock.outputs(k)] and (counts == n).all():
            continue
        here = states.messages(reader.topics)
        for k in ks:
            if absent := _absent_state(here, clock, k, topics):
                raise UnreadableError(
                    f"{reader.path}: tick {k}, t = {absent.t:g} s: has no message of "
                    f"{absent.topic}; what its robot did is not known"
                )


def _unseen(reader: Reader, clock: Clock, k: int) -> int:
    """Return how many messages of the run are here of ticks after tick k."""
    said, start_ns = _said(reader.topics), clock.t(k) + 1 if k >= 0 else 0
    return sum(len(part.on(said).time) for part in reader.columns(start_ns=start_ns))


def _missing(reader: Reader) -> int | None:
    """Return how many messages are not here that the run had; None where that is not known."""
    if reader.digest:
        return 0
    planned = int(reader.end["messages"]) if reader.end else 0
    return planned - reader.message_count if planned > reader.message_count else None


def _finder(reader: Reader, experiment: Experiment) -> Find:
    return find_recorded(about(reader).plants, experiment)


def expect_same_types(reader: Reader, experiment: Experiment) -> Mapping[str, Codec]:
    """Return what codes the messages of a recording, which are those that its run would have now.

    `InputError` where an algorithm of the name is installed that declares other fields.
    """
    types, now = recorded_types(reader), declared_types(experiment.codecs)
    recorded = types.codecs
    for kind, codec in now.items():
        was, is_now = contents_of(recorded.get(kind)), contents_of(codec)
        without = kind == "link_event" and not types.channels[kind]  # as no link has impairments
        if was != is_now and not without:
            raise InputError(
                f"{reader.path}: a {kind} has {shortened(was)}, but of the algorithm "
                f"{experiment.scenario.algorithm.name} as it is installed here it has "
                f"{shortened(is_now)}: install the version that it was recorded with"
            )
    return recorded


def states_of(reader: Reader) -> Iterator[Records]:
    """Yield a recording's states by tick, from 0 on."""
    types = recorded_types(reader)
    codec, numbers = types.codecs["state"], types.channels["state"]
    return (_records(reader, codec, tick.on(numbers)) for tick in ticks(reader))


def _records(reader: Reader, codec: Codec, messages: Columns) -> Records:
    try:
        return codec.parsed(messages.payloads(codec.size))
    except (BusError, DamageError) as error:
        raise UnreadableError(f"{reader.path}: {error}") from error


def _said(topics: Mapping[int, str]) -> list[int]:
    """Return the channels that say something of the run; checkpoints are the plants' own affair."""
    return [number for number, topic in topics.items() if kind_of(topic) in KINDS]
