"""The workers of a run that are processes of their own, here or elsewhere.

Every robot has a slot, and a slot has at most one worker at a time; `worker_state` draws its life.
A worker asks to be let in, opens its robots, says that it is ready, and is told to begin when every
slot has one. A worker whose link or presence ends is gone: its slot waits for another, which is
told to begin where the recording allows, while the rest of the run goes on as far as the data lets
it. Here is what is said on the bus: each event is read, and the state answers what may follow.
"""

import logging
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from time import monotonic
from typing import Any

from nrs_cosim.bus.errors import BusError, InputError, RunError
from nrs_cosim.bus.keys import (
    ALIVE,
    FMU,
    JOIN,
    MISSED,
    ORCHESTRATOR,
    ORDERS,
    RECORDS,
    REPORT,
    SAMPLES,
    START,
    wire_key,
)
from nrs_cosim.bus.network.zenoh_bus import ZenohBus, ZenohInbox
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Cut, Item, Message, Presence, Question, Rejected
from nrs_cosim.bus.validation import Wire
from nrs_cosim.orchestrator.cluster.admission import Admission, Fmu
from nrs_cosim.orchestrator.cluster.answers import Answers
from nrs_cosim.orchestrator.cluster.assignment import Assignment, WorkerSlot
from nrs_cosim.orchestrator.cluster.local_worker import LocalWorker
from nrs_cosim.orchestrator.cluster.protocol import END, NotExpectedError, Refusal, Report
from nrs_cosim.orchestrator.cluster.supervision import Supervision, WorkerPolicy
from nrs_cosim.orchestrator.cluster.worker_state import WELL, Event, State, WorkerState
from nrs_cosim.orchestrator.engine.robots import wire_of
from nrs_cosim.orchestrator.engine.worker import Spent
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.robot_ids import named
from nrs_cosim.recordings.recorder import Recorder

_LOG = logging.getLogger(__name__)

_LOOK = 0.25
"""s: how long nothing may come before it is looked whether the workers are well."""
_FAREWELL = 5.0
"""s: how long to wait for workers when all else is done: for their reports, then for their end."""
_GRACE = 2.0
"""s: how long workers may take to end when they are told to."""


class Coordinator:
    """The workers of a run; see `orchestrator.engine.lockstep.Workers`."""

    def __init__(
        self,
        bus: ZenohBus,
        inbox: ZenohInbox,
        file: Experiment,
        fmus: Mapping[str, Fmu],
        assignment: Mapping[str, Sequence[int]],
        policy: WorkerPolicy,
        start: Callable[[str, Sequence[int]], LocalWorker] | None,
        secret: bytes,
    ) -> None:
        """Let workers of a scenario in, from now on; `fmus` are by what the scenario calls them.

        `assignment` are those whose workers' names are known; further ones come about as workers
        ask.
        """
        self.inbox = inbox
        self.rejected: Counter[str] = Counter()
        self._slots = Assignment(file.n, policy.expected)
        self._bus, self._file, self._policy = bus, file, policy
        self._signer = Signer(secret)
        self._admission = Admission(bus.run_id, file, fmus, secret, self._slots)
        self._supervision = Supervision(self._slots, policy, start)
        self._answers = Answers(self._slots, self._signer, self._supervision, self._admission)
        self._is_over = False
        for kind in (JOIN, START, MISSED, FMU):
            bus.serve(wire_key(kind, "*"), inbox)
        bus.watch(wire_key(ALIVE, "*/*"), inbox)
        bus.watch_links(inbox)
        bus.announce(wire_key(ALIVE, ORCHESTRATOR))
        for name, robots in assignment.items():
            self._slots[name] = WorkerSlot(robots, WorkerState(monotonic()), reserved=True)

    @property
    def restarts(self) -> int:
        """How often a worker was lost, and the run went on."""
        return self._supervision.restarts

    @property
    def asked(self) -> Counter[str]:
        """How often workers asked for samples: to catch up, or because they were late."""
        return self._answers.asked

    @property
    def assignment(self) -> dict[str, Sequence[int]]:
        """Return which robots each worker has."""
        return {name: slot.robots for name, slot in self._slots.items()}

    def gather(self) -> None:
        """Start the workers of this machine, and wait until every robot has a worker that is ready.

        Raises the `InputError` of a worker of this machine, and `RunError` when some do not come.
        """
        if not self._supervision.start_all():
            self._policy.show(f"run {self._bus.run_id} waits for workers{self._slots.missing()}")
        slots = self._slots
        while slots.free or not all(slot.state is State.READY for slot in slots.values()):
            for item in self.inbox.take(_LOOK):
                self.handle(item)
            self.look_after(0)

    def wire(self) -> Wire:
        """Return the wire between the workers that were gathered."""
        return wire_of(self._file, self.assignment, self._signer)

    def describe_plants(self) -> list[dict[str, Any]]:
        """Return what the user is told of the plants, by group, whatever worker they are on."""
        return self._slots.describe_plants()

    def begin(self, recorder: Recorder) -> None:
        """Tell all workers to begin where a recording ends."""
        self._supervision.recorder = recorder
        for slot in self._slots.values():
            self._answers.send_off(slot)

    def advance(self, k: int, until: int) -> None:
        """Do nothing: workers advance by themselves."""

    def handle(self, item: Item) -> None:
        """Take what came and is neither samples nor records."""
        if isinstance(item, Question):
            self._answer(item)
        elif isinstance(item, Presence):
            name, _, incarnation = item.key.partition("/")[2].partition("/")
            slot = self._slots.get(name)
            if slot and slot.life.incarnation == incarnation:
                if item.here:
                    slot.life.on(Event.APPEAR)
                else:
                    self._supervision.lose(name, slot)
        elif isinstance(item, Cut):
            for name, slot in list(self._slots.items()):
                if slot.is_here and item.peer in {None, slot.life.incarnation}:
                    self._supervision.lose(name, slot)
        elif isinstance(item, Message):
            self._read_report(item)
        elif isinstance(item, Rejected):
            self.rejected[item.why] += 1

    def _answer(self, question: Question) -> None:
        kind, _, name = question.key.partition("/")
        answers = {
            JOIN: self._join,
            START: self._answers.start,
            MISSED: self._answers.samples,
            FMU: self._answers.fmu,
        }
        if self._is_over:
            if kind == JOIN and (slot := self._slots.get(name)):
                slot.life.join("", monotonic())
                over = Refusal(reason="the run is over", final=True, over=True)
                question.answer(over.written())
        elif kind in answers:
            try:
                answers[kind](name, question)
            except NotExpectedError:
                self.rejected[kind] += 1
        else:
            self.rejected["question"] += 1

    def look_after(self, k: int, at_last: bool = False) -> bool:
        """Look whether the workers are well; return whether all are, and none is catching up.

        Raises what a worker failed with at tick k or before, and `RunError` when a robot has been
        without a worker for too long; see `orchestrator.engine.lockstep.Workers`.
        """
        are_well = self._supervision.look_after(k, at_last)
        progress, self._answers.progress = self._answers.progress, False
        return are_well and not progress

    def spent(self) -> dict[str, Spent]:
        """Return where the time of each worker went, as far as it said so."""
        return {
            name: Spent(slot.report.plants, slot.report.bus, slot.report.waiting)
            for name, slot in self._slots.items()
            if slot.report
        }

    def end(self) -> None:
        """Let all workers end, and collect how it was."""
        slots, recorder = self._slots.values(), self._supervision.recorder
        done = recorder and recorder.closed == self._file.clock.ticks
        self._is_over = True
        were_well = [slot for slot in slots if slot.state in WELL]
        for slot in slots:
            slot.life.on(Event.END)
        if done:
            self._wait_for_ends(lambda: all(s.report or s.state is not State.ENDING for s in slots))
        for name in self._slots:
            key = wire_key(ORDERS, name)
            self._bus.publisher(key)(self._signer.sign(key, END))
        remote = [slot for slot in slots if not slot.process]
        self._wait_for_ends(lambda: all(slot.state is State.LEFT for slot in remote))
        until = monotonic() + _GRACE
        for slot in slots:
            if slot.process:
                slot.process.wait(max(until - monotonic(), 0.0) if slot in were_well else 0.0)

    def _wait_for_ends(self, is_enough: Callable[[], bool]) -> None:
        """Hear how workers end, and tell those that come back that the run is over."""
        until = monotonic() + _FAREWELL
        while not is_enough() and monotonic() < until:
            for item in self.inbox.take(_LOOK):
                self.handle(item)

    def close(self) -> None:
        """Kill what still runs on this machine."""
        for slot in self._slots.values():
            if slot.process:
                slot.process.kill()

    def _join(self, name: str, question: Question) -> None:
        slot = self._admission.answer(name, question, monotonic())
        if slot:
            self._supervision.unable.pop(name, None)
            _LOG.info("%s joined with %s", name, named(slot.robots))
        if slot and not slot.process:
            missing = self._slots.missing()
            self._policy.show(f"{name} has joined with {named(slot.robots)}{missing}")

    def _read_report(self, message: Message) -> None:
        kind, _, name = message.key.partition("/")
        if self._is_over and kind in (SAMPLES, RECORDS):  # of ticks that are not recorded any more
            return
        slot = self._slots.get(name) or self._supervision.departed.get(name)
        slot = slot if kind in (REPORT, ORDERS) else None
        if slot is None:
            self.rejected["key"] += 1
            return
        data = self._signer.verify(message.key, message.payload)
        if data is None:
            self.rejected["signature"] += 1
            return
        if kind == ORDERS:  # one's own
            return
        if data == END:
            slot.life.on(Event.ACKNOWLEDGE)
            return
        try:
            report: Report = Report.read(data)
        except BusError:
            self.rejected["form"] += 1
            return
        if name in self._slots:
            self._take_report(name, slot, report)
        elif report.failed:
            self._supervision.unable[name] = report.failed
            self._policy.show(f"{name} could not open {named(slot.robots)}: {report.failed}")

    def _take_report(self, name: str, slot: WorkerSlot, report: Report) -> None:
        slot.report = report
        ended = f"failed: {report.failed}" if report.failed else "is done"
        _LOG.info("%s %s at tick %d", name, ended, report.tick)
        slot.life.on(Event.FAIL if report.failed else Event.FINISH)
        if report.tick < 0 and report.failed and not self._is_over:
            if slot.process:
                raise (RunError if self._supervision.recorder else InputError)(report.failed)
            self._supervision.unable[name] = report.failed
            self._policy.show(f"{name} cannot open {named(slot.robots)}: {report.failed}")
