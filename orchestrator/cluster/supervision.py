"""Workers are watched: one that is lost is started again or waited for, one that failed is told.

What each state means is in `worker_state`; here is what is done about it, with the words for it.
"""

import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from time import monotonic

from nrs_cosim.bus.errors import RunError
from nrs_cosim.bus.keys import RECORDS, SAMPLES
from nrs_cosim.orchestrator.cluster import worker_state
from nrs_cosim.orchestrator.cluster.assignment import Assignment, WorkerSlot
from nrs_cosim.orchestrator.cluster.local_worker import LocalWorker
from nrs_cosim.orchestrator.cluster.worker_state import (
    MOST_DEATHS,
    WELL,
    WITHOUT_WORKER,
    State,
)
from nrs_cosim.orchestrator.engine.worker import RECEIVES
from nrs_cosim.orchestrator.errors import WorkerError
from nrs_cosim.orchestrator.scenario.robot_ids import named
from nrs_cosim.recordings.recorder import Recorder


@dataclass(frozen=True, slots=True)
class WorkerPolicy:
    """What is done about workers that come and go."""

    restart: bool
    """Whether the run goes on without one that is gone."""
    wait: float
    """s: how long a robot may be without a worker."""
    show: Callable[[str], None]
    """Is told in words who comes and goes."""
    expected: int = 1
    """How many workers share the robots, where they do not name their robots."""


_LOG = logging.getLogger(__name__)


@dataclass(slots=True)
class Supervision:
    """Looks after the workers of a run."""

    slots: Assignment
    policy: WorkerPolicy
    start: Callable[[str, Sequence[int]], LocalWorker] | None
    """Starts a worker on this machine; None when they come from elsewhere."""
    recorder: Recorder | None = None
    """None until the run begins."""
    restarts: int = 0
    """How often a worker was lost, and the run went on."""
    began: float = field(default_factory=monotonic)
    departed: dict[str, WorkerSlot] = field(default_factory=dict)
    """Slots that were given up before the run: why may be said after the worker is gone, for its
    last words and its presence travel side by side."""
    unable: dict[str, str] = field(default_factory=dict)
    """What remote workers said that could not open their robots, and have not come again since."""

    def start_all(self) -> bool:
        """Start the workers of this machine; return whether they are to be started here."""
        if self.start is None:
            return False
        for name, slot in self.slots.items():
            self._start(name, slot)
        return True

    def _start(self, name: str, slot: WorkerSlot) -> None:
        if self.start is not None:
            slot.process = self.start(name, slot.robots)
            slot.life.start(monotonic())

    def look_after(self, k: int, at_last: bool) -> bool:
        """Look whether the workers are well; return whether all of them are.

        See `orchestrator.engine.lockstep.Workers` for what it raises.
        """
        now = monotonic()
        for name, slot in list(self.slots.items()):
            has_ended = slot.process and slot.process.ending() is not None
            if has_ended or slot.life.never_appeared(now):
                self.lose(name, slot)
        self._raise_failure(k, at_last)
        self._expect_in_time(now)
        return all(slot.state in WELL for slot in self.slots.values())

    def _expect_in_time(self, now: float) -> None:
        """Raise `WorkerError` when a worker has been waited for long enough."""
        wait = self.policy.wait
        lacking = dict(self.slots.without_worker()) | dict.fromkeys(self.slots.free, self.began)
        if lacking and now - min(lacking.values()) >= wait:
            came = self.slots.refusal or "no `nrs worker` came for them; --wait gives them longer"
            if self.unable:
                came = f"{self._unable()}; mend that, or start others"
            raise WorkerError(f"{named(sorted(lacking))} had no worker for {wait:g} s: {came}")
        for name, slot in self.slots.items():
            if not slot.process:
                continue
            who = f"worker {name} ({named(slot.robots)})"
            if slot.life.never_joined(now):
                raise WorkerError(
                    f"{who}, a process of this machine, did not ask to join within "
                    f"{worker_state.STARTING_UP:g} s of its start{slot.process.last_words()}"
                )
            if slot.state in WITHOUT_WORKER and now - slot.life.since >= wait:
                raise WorkerError(
                    f"{who} was not ready within {wait:g} s of its start; --wait gives it longer"
                )

    def _unable(self) -> str:
        """Say who came and could not open its robots, and why: a reason once."""
        names: dict[str, list[str]] = {}
        for name, why in sorted(self.unable.items()):
            names.setdefault(why, []).append(name)
        return "; ".join(
            f"{' and '.join(who)} came, and could not open robots: {why}"
            for why, who in names.items()
        )

    def _raise_failure(self, k: int, at_last: bool) -> None:
        """Raise what workers failed with at tick k, or while they came there.

        When each worker is there, or has failed, the first in the order of one process is known.
        Where the first failed on what it received, all have sent their samples, and so no worker is
        kept from receiving them too.
        """
        failed = {
            name: slot.report
            for name, slot in self.slots.items()
            if slot.report and slot.report.failed
            if (slot.process or slot.report.tick >= 0) and slot.report.tick <= k
        }
        if not failed:
            return
        first = min(failed.values(), key=lambda report: (report.tick, report.place))
        missing = self.recorder.missing(k) if self.recorder else {}
        came = SAMPLES if k and first.place[1] < RECEIVES else RECORDS
        if at_last or all(
            name in failed or came not in missing.get(name, ()) for name in self.slots
        ):
            raise RunError(str(first.failed), first.cause)

    def lose(self, name: str, slot: WorkerSlot) -> None:
        """Do without a worker that is gone, or start it again."""
        closed = self.recorder.closed if self.recorder else -1
        if not slot.life.lose(closed, monotonic()) or slot.state is not State.VACANT:
            return
        how = slot.process.kill() if slot.process else "is gone"
        event = f"{name} ({named(slot.robots)}) {how}, after tick {max(closed, 0)}"
        deaths = slot.life.deaths
        if slot.process and deaths > MOST_DEATHS:
            raise WorkerError(f"worker {event}, for the {deaths}th time in a row")
        _LOG.warning("%s", event)
        if self.recorder is None:
            if not slot.reserved:
                self.departed[name] = slot
                del self.slots[name]
        elif not self.policy.restart:
            raise WorkerError(f"worker {event}")
        else:
            self.restarts += 1
        if slot.process and self.start:
            self.policy.show(f"{event}; it is started again")
            self._start(name, slot)
        else:
            self.policy.show(f"{event}; waiting for it to come back{self.slots.missing()}")
