"""Every robot has a slot, and a slot has at most one worker at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from typing import Any

from nrs_cosim.bus.text import quoted
from nrs_cosim.bus.transport import Put
from nrs_cosim.orchestrator.cluster.local_worker import LocalWorker
from nrs_cosim.orchestrator.cluster.protocol import Hello, Report
from nrs_cosim.orchestrator.cluster.worker_state import (
    UNOCCUPIED,
    WITHOUT_WORKER,
    State,
    WorkerState,
)
from nrs_cosim.orchestrator.scenario.robot_ids import named


def _nobody(_data: bytes) -> None:
    """Answer nobody."""


class NotAdmittedError(Exception):
    """A worker that cannot have the slot that it asks for; `final` if asking again is of no use."""

    def __init__(self, reason: str, *, final: bool) -> None:
        super().__init__(reason)
        self.final = final


@dataclass(slots=True, eq=False)
class WorkerSlot:
    """Some robots, and the worker that has them."""

    robots: Sequence[int]
    life: WorkerState
    process: LocalWorker | None = None
    """When the orchestrator starts it."""
    reserved: bool = False
    """For a worker of this name, also when it does not come."""
    hello: bytes = b""
    """What its worker said to be let in, and says again where the answer was lost."""
    welcome: bytes = b""
    """The answer, which that worker alone can read."""
    plants: list[dict[str, Any]] = field(default_factory=list)
    begin: Put = _nobody
    """Answers a worker that is ready and waits to be told where to begin."""
    report: Report | None = None
    """The last of its workers since one was ready."""

    @property
    def state(self) -> State:
        """How far its worker is."""
        return self.life.state

    @property
    def is_here(self) -> bool:
        """Whether a worker was let in, and is neither lost nor gone."""
        return self.state not in UNOCCUPIED


class Assignment(dict[str, WorkerSlot]):
    """The slots of n robots, by the names of their workers."""

    def __init__(self, n: int, expected: int) -> None:
        """Let so many workers share the robots, of those that name none."""
        super().__init__()
        self._n, self._expected = n, expected
        self.free: Sequence[int] = range(1, n + 1)
        """The robots that have no worker yet, ascending."""
        self.refusal = ""
        """Who was not let in last, and why."""

    def __setitem__(self, name: str, slot: WorkerSlot) -> None:
        """Let a worker have a slot; its robots are free until then."""
        super().__setitem__(name, slot)
        taken = {*slot.robots}
        self.free = [robot for robot in self.free if robot not in taken]

    def __delitem__(self, name: str) -> None:
        """Let a worker go for good; its robots are free again."""
        self.free = sorted([*self.free, *self[name].robots])
        super().__delitem__(name)

    def missing(self) -> str:
        """Say who is missing, as the end of a sentence; nothing when nobody is."""
        vacant = [f"worker {name}" for name, slot in self.items() if not slot.is_here]
        missing = ([named(self.free)] if self.free else []) + vacant
        return f"; missing: {', '.join(missing)}" if missing else ""

    def without_worker(self) -> Iterator[tuple[int, float]]:
        """Yield the robots whose remote worker is not here, and since when."""
        for slot in self.values():
            if slot.state in WITHOUT_WORKER and not slot.process:
                yield from ((robot, slot.life.since) for robot in slot.robots)

    def place(self, name: str, hello: Hello, now: float) -> WorkerSlot:
        """Return the slot of a worker that may have it; `NotAdmittedError` when it may not."""
        if hello.version != version("nrs-cosim"):
            raise NotAdmittedError(
                f"the run is of nrs-cosim {version('nrs-cosim')}, the worker of {hello.version}: "
                "install the same",
                final=True,
            )
        slot = self.get(name)
        if slot is None:
            slot = self._new(hello, now)
            self[name] = slot
        elif slot.is_here:
            raise NotAdmittedError(
                f"there is a worker of the name {quoted(name)} already", final=False
            )
        elif hello.robots is not None and tuple(slot.robots) != hello.robots:
            raise NotAdmittedError(
                f"--robots: {quoted(name)} has {named(slot.robots)} in this run, not "
                f"{named(hello.robots)}",
                final=True,
            )
        return slot

    def _new(self, hello: Hello, now: float) -> WorkerSlot:
        free = self.free
        if not free:
            vacant = [
                f"{name} ({named(slot.robots)})" for name, slot in self.items() if not slot.is_here
            ]
            raise NotAdmittedError(
                "every robot has a worker"
                + (f"; take the place of {' or '.join(vacant)} by --name" if vacant else ""),
                final=not vacant,
            )
        if hello.robots is None:
            left = max(self._expected - len(self), 1)
            return WorkerSlot(free[: -(-len(free) // left)], WorkerState(now))
        if not hello.robots or not {*hello.robots} <= {*free}:
            beyond = sorted({*hello.robots}.difference(range(1, self._n + 1)))
            nowhere = f", and the run has no {named(beyond)}" if beyond else ""
            raise NotAdmittedError(
                f"--robots: {named(free)} of {self._n} have no worker yet, but "
                f"this worker asks for {named(hello.robots) if hello.robots else 'none'}{nowhere}",
                final=True,
            )
        return WorkerSlot(sorted({*hello.robots}), WorkerState(now))

    def describe_plants(self) -> list[dict[str, Any]]:
        """Return what the user is told of the plants, by group, whatever worker they are on."""
        merged: dict[str, dict[str, Any]] = {}
        for slot in self.values():
            for plant in slot.plants:
                same = str({**plant, "robots": None})
                merged.setdefault(same, {**plant, "robots": []})["robots"] += plant["robots"]
        for plant in merged.values():
            plant["robots"].sort()
        return sorted(merged.values(), key=lambda plant: plant["robots"][0])
