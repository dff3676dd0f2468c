"""The workers of a run that are processes of their own, here or elsewhere.

Every robot has a slot, and a slot has at most one worker at a time. A worker asks to be let in,
opens its robots, says that it is ready, and is told to begin when every slot has one. A worker
whose link or presence ends is gone: its slot waits for another, which is told to begin where the
recording allows, while the rest of the run goes on as far as the data lets it.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any

from nrs_cosim.bus.errors import BusError, InputError, RunError
from nrs_cosim.bus.keys import (
    ALIVE,
    FMU,
    HEARD,
    JOIN,
    ORCHESTRATOR,
    ORDERS,
    RECORDS,
    REPORT,
    SAMPLES,
    START,
    wire_key,
)
from nrs_cosim.bus.network.access import expect_worker_name
from nrs_cosim.bus.network.zenoh_bus import ZenohBus, ZenohInbox
from nrs_cosim.bus.parts import joined
from nrs_cosim.bus.seal import Seal
from nrs_cosim.bus.text import storable
from nrs_cosim.bus.transport import Cut, Item, Message, Presence, Question, Rejected, Screen
from nrs_cosim.bus.wire import Wire
from nrs_cosim.orchestrator.cluster.assignment import Assignment, NotAdmittedError, WorkerSlot
from nrs_cosim.orchestrator.cluster.local_worker import STARTING, LocalWorker
from nrs_cosim.orchestrator.cluster.protocol import (
    END,
    TICK,
    Go,
    Hello,
    Ready,
    Refusal,
    Report,
    Welcome,
)
from nrs_cosim.orchestrator.errors import WorkerError
from nrs_cosim.orchestrator.runs.restart import AT_ONCE, point_of
from nrs_cosim.orchestrator.runs.robots import wire_of
from nrs_cosim.orchestrator.runs.worker import Spent
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.numbers import named
from nrs_cosim.recordings.recorder import Recorder

_MOST_DEATHS = 3
_LONGEST_HELLO = 2**20
"""Bytes of what a worker says to be let in, which is the one thing that is not sealed."""
_ASKED = (START, HEARD, FMU)
_SEALED = (SAMPLES, RECORDS, REPORT, ORDERS, *_ASKED)
_COMING = 10.0
"""s: how long a worker that is let in may take to be present."""
_LOOK = 0.25
"""s: how long nothing may come before it is looked whether the workers are well."""
_FAREWELL = 5.0
"""s: how long to wait for workers when all else is done: for their reports, then for their end."""
_GRACE = 2.0
"""s: how long workers may take to end when they are told to."""


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """How a run treats its workers."""

    expected: int
    """How many there will be, when those that name no robots are to share them."""
    start: Callable[[str, Sequence[int]], LocalWorker] | None
    """Starts a worker on this machine; None when they come from elsewhere."""
    restart: bool
    """Whether the run goes on when one is gone."""
    wait: float
    """s: how long a robot may be without a worker."""
    show: Callable[[str], None]
    """Is told in words who comes and goes."""


def screen_of(seal: Seal) -> Screen:
    """Return what keeps of all that comes only what is under a run's seal, and short questions."""

    def screen(key: str, payload: bytes) -> str | None:
        kind = key.partition("/")[0]
        if kind == JOIN:
            return kind if len(payload) > _LONGEST_HELLO else None
        if kind not in _SEALED:
            return "key"
        if seal.opened(key, payload) is not None:
            return None
        return kind if kind in _ASKED else "seal"

    return screen


@dataclass(frozen=True, slots=True)
class Fmu:
    """An FMU of the scenario."""

    sha256: str
    content: Callable[[], bytes]


class Coordinator:
    """The workers of a run; see `orchestrator.runs.lockstep.Workers`."""

    def __init__(
        self,
        bus: ZenohBus,
        inbox: ZenohInbox,
        file: Experiment,
        fmus: Mapping[str, Fmu],
        assignment: Mapping[str, Sequence[int]],
        terms: Terms,
        secret: bytes,
    ) -> None:
        """Let workers of a scenario in, from now on; `fmus` are by what the scenario calls them.

        `assignment` are those whose workers' names are known; further ones come about as workers
        ask.
        """
        self.inbox = inbox
        self.refused: Counter[str] = Counter()
        self.restarts = 0
        self.asked: Counter[str] = Counter()
        """How often workers asked for samples: to catch up, or because they were late."""
        self._slots = Assignment(file.n, terms.expected)
        self._bus, self._file, self._fmus, self._terms = bus, file, fmus, terms
        self._secret, self._seal = secret, Seal(secret)
        self._recorder: Recorder | None = None
        self._began = monotonic()
        self._progress = False
        """Whether a worker got on in what is recorded already, since that was last asked."""
        for kind in (JOIN, START, HEARD, FMU):
            bus.serve(wire_key(kind, "*"), inbox)
        bus.watch(wire_key(ALIVE, "*/*"), inbox)
        bus.watch_links(inbox)
        bus.announce(wire_key(ALIVE, ORCHESTRATOR))
        for name, robots in assignment.items():
            self._slots[name] = WorkerSlot(robots, reserved=True)

    @property
    def assignment(self) -> dict[str, Sequence[int]]:
        """Return which robots each worker has."""
        return {name: slot.robots for name, slot in self._slots.items()}

    def gather(self) -> None:
        """Start the workers of this machine, and wait until every robot has a worker that is ready.

        Raises the `InputError` of a worker of this machine, and `RunError` when some do not come.
        """
        if self._terms.start:
            for name, slot in self._slots.items():
                slot.process, slot.since = self._terms.start(name, slot.robots), monotonic()
        else:
            self._terms.show(f"run {self._bus.run_id} waits for workers{self._slots.missing()}")
        while self._slots.free or not all(slot.begin for slot in self._slots.values()):
            for item in self.inbox.take(_LOOK):
                self.handle(item)
            self.look_after(0)

    def wire(self) -> Wire:
        """Return the wire between the workers that were gathered."""
        return wire_of(self._file, self.assignment, self._seal)

    def told(self) -> list[dict[str, Any]]:
        """Return what the user is told of the plants, by group, whatever worker they are on."""
        return self._slots.told()

    def begin(self, recorder: Recorder) -> None:
        """Tell all workers to begin where a recording ends."""
        self._recorder = recorder
        for slot in self._slots.values():
            self._send_off(slot)

    def advance(self, k: int) -> None:
        """Do nothing: workers advance by themselves."""

    def handle(self, item: Item) -> None:
        """Take what came and is neither samples nor records."""
        if isinstance(item, Question):
            kind, _, name = item.key.partition("/")
            answers = {
                JOIN: self._join,
                START: self._start,
                HEARD: self._tell_heard,
                FMU: self._hand_out,
            }
            if kind in answers:
                answers[kind](name, item)
            else:
                self.refused["question"] += 1
        elif isinstance(item, Presence):
            name, _, incarnation = item.key.partition("/")[2].partition("/")
            slot = self._slots.get(name)
            if slot and slot.incarnation == incarnation:
                slot.present = item.here
                if not item.here:
                    self._lose(name, slot)
        elif isinstance(item, Cut):
            for name, slot in list(self._slots.items()):
                if slot.incarnation is not None and item.peer in {None, slot.incarnation}:
                    self._lose(name, slot)
        elif isinstance(item, Message):
            self._read_report(item)
        elif isinstance(item, Rejected):
            self.refused[item.why] += 1

    def look_after(self, k: int, at_last: bool = False) -> bool:
        """Look whether the workers are well; return whether all are there and none is catching up.

        Raises what a worker failed with at tick k or before, and `RunError` when a robot has been
        without a worker for too long; see `orchestrator.runs.lockstep.Workers`.
        """
        for name, slot in list(self._slots.items()):
            never_came = slot.incarnation and not slot.present and slot.seconds >= _COMING
            if never_came or (slot.process and slot.process.ending() is not None):
                self._lose(name, slot)
        self._fail(k, at_last)
        without_worker = dict(self._slots.without_worker()) | dict.fromkeys(
            self._slots.free, self._began
        )
        if without_worker and monotonic() - min(without_worker.values()) >= self._terms.wait:
            who = named(sorted(without_worker))
            raise WorkerError(
                f"{who} had no worker for {self._terms.wait:g} s: no `nrs worker` came for them; "
                "--wait gives them longer"
            )
        for name, slot in self._slots.items():
            if slot.process and slot.incarnation is None and slot.seconds >= STARTING:
                raise WorkerError(
                    f"worker {name} ({named(slot.robots)}), a process of this machine, did not ask "
                    f"to join within {STARTING:g} s of its start{slot.process.last_words()}"
                )
            # One that waits for the others to be gathered is ready too.
            is_there = slot.is_ready or slot.begin
            if slot.process and not is_there and slot.seconds >= self._terms.wait:
                raise WorkerError(
                    f"worker {name} ({named(slot.robots)}) was not ready within "
                    f"{self._terms.wait:g} s of its start; --wait gives it longer"
                )
        progress, self._progress = self._progress, False
        return not progress and all(slot.is_ready for slot in self._slots.values())

    def spent(self) -> dict[str, Spent]:
        """Return where the time of each worker went, as far as it said so."""
        return {
            name: Spent(slot.report.plants, slot.report.bus, slot.report.waiting)
            for name, slot in self._slots.items()
            if slot.report
        }

    def end(self) -> None:
        """Let all workers end, and hear how it was."""
        done = self._recorder and self._recorder.closed == self._file.clock.ticks
        slots = self._slots.values()
        if done:
            self._hear_out(lambda: all(slot.report or not slot.present for slot in slots))
        for name in self._slots:
            key = wire_key(ORDERS, name)
            self._bus.publisher(key)(self._seal.closed(key, END))
        away = [slot for slot in slots if not slot.process]
        self._hear_out(lambda: not any(slot.present or slot.is_away for slot in away))
        until = monotonic() + _GRACE
        for slot in slots:
            if slot.process:
                slot.process.wait(max(until - monotonic(), 0.0) if slot.is_ready else 0.0)

    def _hear_out(self, is_enough: Callable[[], bool]) -> None:
        """Hear how workers end, and tell those that come back that the run is over."""
        until = monotonic() + _FAREWELL
        while not is_enough() and monotonic() < until:
            for item in self.inbox.take(_LOOK):
                if isinstance(item, Message | Rejected):
                    self.handle(item)
                for name, slot in self._slots.items():
                    present = wire_key(ALIVE, f"{name}/{slot.incarnation}")
                    cut = isinstance(item, Cut) and item.peer in {None, slot.incarnation}
                    if slot.present and (cut or item == Presence(present, here=False)):
                        slot.present, slot.is_away = False, not slot.knows
                    elif isinstance(item, Question) and item.key == wire_key(JOIN, name):
                        over = Refusal(reason="the run is over", final=True, over=True)
                        item.answer(over.written())
                        slot.is_away = False

    def close(self) -> None:
        """Kill what still runs on this machine."""
        for slot in self._slots.values():
            if slot.process:
                slot.process.kill()

    def _join(self, name: str, question: Question) -> None:
        # A run without workers has nothing to encrypt, and need not wait for what does it.
        from nrs_cosim.bus.encryption import encrypt, expect_public_key  # noqa: PLC0415

        try:
            expect_worker_name(name, "--name")
            hello: Hello = Hello.read(question.payload)
            expect_public_key(hello.public)
            slot = self._slots.get(name)
            if slot and slot.incarnation == hello.incarnation:
                self._repeat(slot, question)
                return
            slot = self._slots.place(name, hello)
        except (BusError, InputError, NotAdmittedError) as error:
            final = not isinstance(error, NotAdmittedError) or error.final
            question.answer(Refusal(reason=str(error), final=final).written())
            return
        slot.admit(hello.incarnation)
        if not slot.process:
            missing = self._slots.missing()
            self._terms.show(f"{name} has joined with {named(slot.robots)}{missing}")
        file = self._file
        welcome = Welcome(
            run=self._bus.run_id,
            secret=self._secret,
            name=file.name,
            scenario=file.text,
            folder=storable(str(file.folder.absolute())) if slot.process else None,
            fmus={fmu: about.sha256 for fmu, about in self._fmus.items()},
            robots=tuple(slot.robots),
        )
        where = f"{self._bus.run_id}/{question.key}"
        slot.hello = question.payload
        slot.welcome = encrypt(hello.public, where, welcome.written())
        question.answer(slot.welcome)

    def _repeat(self, slot: WorkerSlot, question: Question) -> None:
        """Answer a worker that asks again, as one does whose answer was lost, with the same bytes.

        An incarnation is public: one that asks in other words is a stranger, and is not answered;
        nor is anyone once the worker is ready.
        """
        if question.payload == slot.hello and not (slot.begin or slot.is_ready):
            question.answer(slot.welcome)
        else:
            self.refused[JOIN] += 1

    def _start(self, name: str, question: Question) -> None:
        slot, data = self._slots.get(name), self._seal.opened(question.key, question.payload)
        try:
            ready: Ready = Ready.read(data or b"")
        except BusError:
            slot = None
        if slot is None or slot.incarnation != ready.incarnation or slot.begin or slot.is_ready:
            self.refused[START] += 1
            return
        robots = sorted(robot for told in ready.plants for robot in told.robots)
        if robots != [*slot.robots] or not all(told.robots for told in ready.plants):
            self.refused[START] += 1
            return
        key = f"{question.key}/{ready.incarnation}"
        slot.plants = [told.model_dump() | {"robots": [*told.robots]} for told in ready.plants]
        slot.begin, slot.report = lambda go: question.answer(self._seal.closed(key, go)), None
        if self._recorder is not None:
            self._send_off(slot)

    def _send_off(self, slot: WorkerSlot) -> None:
        """Tell a worker that is ready where to begin."""
        recorder = self._recorder
        if recorder is None or slot.begin is None:
            return
        point = point_of(slot.robots, recorder.checkpoints, recorder.closed)
        assignment = {name: tuple(each.robots) for name, each in self._slots.items()}
        go = Go(assignment=assignment, start=point.start, recorded=point.recorded)
        slot.begin(go.with_checkpoints(point.checkpoints))
        slot.begin, slot.is_ready = None, True
        slot.recorded, slot.caught_up = point.recorded, -1

    def _tell_heard(self, name: str, question: Question) -> None:
        """Answer with the samples of the next ticks that are known."""
        recorder, slot = self._recorder, self._slots.get(name)
        data = self._seal.opened(question.key, question.payload)
        if slot is None or recorder is None or data is None or len(data) != TICK.size:
            self.refused[HEARD] += 1
            return
        (since,) = TICK.unpack(data)
        if slot.caught_up < since <= recorder.closed:
            slot.caught_up, self._progress = since, True
        self.asked["late" if since > slot.recorded + 1 else "to catch up"] += 1
        known = recorder.samples(since, since + AT_ONCE - 1)
        parts = (
            part
            for k, records, worker in known
            for part in (TICK.pack(k), records.tobytes(), worker.encode())
        )
        question.answer(self._seal.closed(f"{question.key}/answer", joined(parts)))

    def _hand_out(self, sha256: str, question: Question) -> None:
        found = [fmu for fmu in self._fmus.values() if fmu.sha256 == sha256]
        if not found or self._seal.opened(question.key, question.payload) is None:
            self.refused[FMU] += 1
            return
        try:
            content = found[0].content()
        except OSError as error:
            self._terms.show(f"an FMU that a worker asks for cannot be read: {error}")
            question.answer(b"")
        else:
            question.answer(content)

    def _read_report(self, message: Message) -> None:
        kind, _, name = message.key.partition("/")
        slot = self._slots.get(name) if kind in (REPORT, ORDERS) else None
        if slot is None:
            self.refused["key"] += 1
            return
        data = self._seal.opened(message.key, message.payload)
        if data is None:
            self.refused["seal"] += 1
            return
        if kind == ORDERS:  # one's own
            return
        if data == END:
            slot.knows = True
            return
        try:
            report: Report = Report.read(data)
        except BusError:
            self.refused["form"] += 1
            return
        slot.report = report
        if report.tick < 0 and report.failed:
            if slot.process:
                raise (RunError if self._recorder else InputError)(report.failed)
            self._terms.show(f"{name} cannot open {named(slot.robots)}: {report.failed}")

    def _fail(self, k: int, at_last: bool) -> None:
        """Raise what workers failed with at tick k, or while they came there.

        When each worker is there, or has failed, the first in the order of one process is known.
        """
        failed = {
            name: slot.report
            for name, slot in self._slots.items()
            if slot.report and slot.report.failed
            if (slot.process or slot.report.tick >= 0) and slot.report.tick <= k
        }
        if not failed:
            return
        missing = self._recorder.missing(k) if self._recorder else {}
        came = SAMPLES if k else RECORDS
        if at_last or all(
            name in failed or came not in missing.get(name, ()) for name in self._slots
        ):
            first = min(failed.values(), key=lambda report: (report.tick, report.place))
            raise RunError(str(first.failed), first.cause)

    def _lose(self, name: str, slot: WorkerSlot) -> None:
        """Do without a worker that is gone, or start it again."""
        if slot.report and slot.report.failed is None:
            slot.incarnation, slot.present, slot.is_away = None, False, True
            return
        how = slot.process.kill() if slot.process else "is gone"
        slot.admit(None)
        closed = self._recorder.closed if self._recorder else -1
        told = f"{name} ({named(slot.robots)}) {how}, after tick {max(closed, 0)}"
        slot.deaths = slot.deaths + 1 if slot.died_at == closed else 1
        slot.died_at = closed
        if slot.process and slot.deaths > _MOST_DEATHS:
            raise WorkerError(f"worker {told}, for the {slot.deaths}th time in a row")
        if self._recorder is None:
            if not slot.reserved:
                del self._slots[name]
        elif not self._terms.restart:
            raise WorkerError(f"worker {told}")
        else:
            self.restarts += 1
        if slot.process and self._terms.start:
            self._terms.show(f"{told}; it is started again")
            slot.process, slot.since = self._terms.start(name, slot.robots), monotonic()
        else:
            self._terms.show(f"{told}; waiting for it to come back{self._slots.missing()}")
