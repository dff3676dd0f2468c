"""What workers that were let in ask for: where to begin, samples that they missed, and FMUs.

All of it is signed. What is not, or has no place in the state of its slot, raises
`NotExpectedError`: it is not answered.
"""

from collections import Counter
from dataclasses import dataclass, field

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.framing import joined
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Question
from nrs_cosim.orchestrator.cluster.admission import Admission
from nrs_cosim.orchestrator.cluster.assignment import Assignment, WorkerSlot
from nrs_cosim.orchestrator.cluster.protocol import TICK, Go, NotExpectedError, Ready
from nrs_cosim.orchestrator.cluster.supervision import Supervision
from nrs_cosim.orchestrator.cluster.worker_state import Event
from nrs_cosim.orchestrator.engine.restart import AT_ONCE, point_of


@dataclass(slots=True)
class Answers:
    """Answers the workers of a run."""

    slots: Assignment
    signer: Signer
    supervision: Supervision
    admission: Admission
    asked: Counter[str] = field(default_factory=Counter)
    """How often workers asked for samples: to catch up, or because they were late."""
    progress: bool = False
    """Whether a worker got on in what is recorded already; see `Coordinator.look_after`."""

    def start(self, name: str, question: Question) -> None:
        """Know that a worker is ready, and tell it where to begin once the run has begun."""
        try:
            ready: Ready = Ready.read(self._opened(question))
        except BusError as error:
            raise NotExpectedError(str(error)) from None
        slot = self.slots.get(name)
        if slot is None or slot.life.incarnation != ready.incarnation:
            raise NotExpectedError(f"{name} is not the worker that was let in")
        robots = sorted(robot for plant in ready.plants for robot in plant.robots)
        is_whole = robots == [*slot.robots] and all(plant.robots for plant in ready.plants)
        if not (is_whole and slot.life.on(Event.OPEN)):
            raise NotExpectedError(f"{name} is not expected to be ready with robots {robots}")
        key = f"{question.key}/{ready.incarnation}"
        slot.plants = [plant.model_dump() | {"robots": [*plant.robots]} for plant in ready.plants]
        slot.begin, slot.report = lambda go: question.answer(self.signer.sign(key, go)), None
        self.send_off(slot)

    def send_off(self, slot: WorkerSlot) -> None:
        """Tell a worker that is ready where to begin, once the run has begun."""
        recorder = self.supervision.recorder
        if recorder is None:
            return
        point = point_of(slot.robots, recorder.checkpoints, recorder.closed)
        if slot.life.begin(point.recorded):
            assignment = {name: tuple(each.robots) for name, each in self.slots.items()}
            go = Go(assignment=assignment, start=point.start, recorded=point.recorded)
            slot.begin(go.with_checkpoints(point.checkpoints))

    def samples(self, name: str, question: Question) -> None:
        """Answer with the samples of the next ticks that are known."""
        recorder, slot = self.supervision.recorder, self.slots.get(name)
        data = self._opened(question)
        if slot is None or recorder is None or len(data) != TICK.size:
            raise NotExpectedError(f"{name} asks for samples of no tick")
        (since,) = TICK.unpack(data)
        self.progress |= slot.life.catch_up(since, recorder.closed)
        self.asked["late" if since > slot.life.recorded + 1 else "to catch up"] += 1
        known = recorder.samples(since, since + AT_ONCE - 1)
        parts = (
            part
            for k, records, worker in known
            for part in (TICK.pack(k), records.tobytes(), worker.encode())
        )
        question.answer(self.signer.sign(f"{question.key}/answer", joined(parts)))

    def fmu(self, sha256: str, question: Question) -> None:
        """Answer with the bytes of an FMU of the scenario; with none where it cannot be read."""
        self._opened(question)
        found = [fmu for fmu in self.admission.fmus.values() if fmu.sha256 == sha256]
        if not found:
            raise NotExpectedError(f"no FMU of the scenario has SHA-256 {sha256}")
        try:
            content = found[0].content()
        except OSError as error:
            show = self.supervision.policy.show
            show(f"an FMU that a worker asks for cannot be read: {error}")
            content = b""
        question.answer(content)

    def _opened(self, question: Question) -> bytes:
        data = self.signer.verify(question.key, question.payload)
        if data is None:
            raise NotExpectedError(f"{question.key}: the request is not signed")
        return data
