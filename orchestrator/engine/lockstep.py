"""Simulated time advances by data alone: a tick closes when all that it consists of was received.

There is no barrier. A worker goes on as soon as it has the samples that its robots need; the target
puts its own a window of ticks ahead of the last closed tick, and since every worker waits for
those, none runs further ahead of the recorder. When nothing that was missing comes for as long as
the deadline, the run ends, and says who is silent and what they wait for.
"""

from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import ExitStack
from functools import partial
from time import monotonic, perf_counter
from typing import Any, Protocol

import numpy as np

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import BusError, Cause
from nrs_cosim.bus.keys import RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.transport import Bus, Inbox, Item, Message
from nrs_cosim.bus.validation import Wire
from nrs_cosim.estimator_agents.target import Target, sample_of
from nrs_cosim.orchestrator.engine.pace import NO_PACE, Pace
from nrs_cosim.orchestrator.engine.worker import Spent, Watch
from nrs_cosim.orchestrator.scenario.robot_ids import named
from nrs_cosim.recordings.recorder import Recorder

WINDOW_BYTES = 16 * 2**20
"""Of messages that the recorder may have to keep until a tick before them is closed."""
MOST_WINDOW, LEAST_WINDOW = 64, 4
"""Ticks, however few bytes they have, or many."""
AT_ONCE = 512
"""Samples of the target that are worked out at once: arithmetic on few numbers costs as much."""
_BATCHES = (wire_key(SAMPLES, ""), wire_key(RECORDS, ""))
_PATIENCE = 0.25
"""s: how long nothing may come before it is looked whether the workers are well."""


def window(tick_bytes: int) -> int:
    """Return how many ticks workers may be ahead of the recorder, from the bytes of one."""
    return max(LEAST_WINDOW, min(MOST_WINDOW, WINDOW_BYTES // max(tick_bytes, 1)))


class TargetNode:
    """Node 0: it publishes the fields of a sample that the target has, at the sampling times.

    Those of many sampling times are worked out at once.
    """

    def __init__(self, bus: Bus, clock: Clock, wire: Wire, target: Target) -> None:
        self._clock, self._wire, self._target = clock, wire, target
        self._record = wire.samples.blank(np.array([0]))
        self._fields = wire.samples.kind.fields
        self._put = bus.publisher(wire_key(SAMPLES, TARGET))
        self.published = 0
        """The last tick whose sample is published."""
        self._found, self._known = self._record[:0], 0
        """Samples that are worked out, and the tick of the last."""

    def skip_to(self, k: int) -> None:
        """Take the samples up to t_k as published."""
        self.published = max(k, 0)
        self._found, self._known = self._record[:0], self.published

    def publish_until(self, k: int) -> None:
        """Publish the target's samples up to that of t_k which are not published yet."""
        last = min(k, self._clock.ticks)
        while self.published < last:
            if self.published >= self._known:
                self._find(self.published + 1)
            until = min(last, self._known)
            first = self._known - len(self._found) + 1
            found = self._found[self.published + 1 - first : until + 1 - first]
            for payload in self._wire.pack_ahead(TARGET, found):
                self._put(payload)
            self.published = until

    def _find(self, first: int) -> None:
        """Work out the samples of `AT_ONCE` sampling times, or up to the last."""
        ticks = range(first, min(first + AT_ONCE, self._clock.ticks + 1))
        times = [self._clock.t(now) for now in ticks]
        records = np.tile(self._record, len(times))
        records["k"], records["time_ns"] = ticks, times
        at = np.array([seconds(t) for t in times])
        for name, value in sample_of(self._target, self._fields, at).items():
            records[name] = value
        self._found, self._known = records, ticks[-1]


class Workers(Protocol):
    """The workers of a run as the orchestrator sees them."""

    @property
    def inbox(self) -> Inbox:
        """Where all comes that they say."""

    @property
    def rejected(self) -> Counter[str]:
        """What came and was rejected, by reason."""

    @property
    def restarts(self) -> int:
        """How often a worker was gone, and the run went on."""

    @property
    def assignment(self) -> Mapping[str, Sequence[int]]:
        """Which robots each worker has."""

    def wire(self) -> Wire:
        """Return the wire between them."""

    def describe_plants(self) -> Sequence[Mapping[str, Any]]:
        """Return what the user is told of the plants, by group."""

    def begin(self, recorder: Recorder) -> None:
        """Let all workers begin where a recording ends."""

    def advance(self, k: int, until: int) -> None:
        """Let the workers that run in this thread do tick k, and more at once up to `until`."""

    def handle(self, item: Item) -> None:
        """Take what came and is neither samples nor records."""

    def look_after(self, k: int, at_last: bool = False) -> bool:
        """Look whether the workers are well; return whether all are there.

        Raises what a worker failed with at tick k or before, once it is known that none failed with
        what comes first in one process; `at_last` raises what is known.
        """

    def end(self) -> None:
        """Let all workers end, and collect how it was."""

    def spent(self) -> Mapping[str, Spent]:
        """Return where the time of each worker went, as far as it said so."""


Launcher = Callable[[ExitStack, Watch], tuple[Bus, Workers]]
"""Gets a run its workers, ready to begin; the stack ends them."""


class Lockstep:
    """Closes tick after tick of a run."""

    def __init__(
        self,
        clock: Clock,
        target: TargetNode,
        workers: Workers,
        recorder: Recorder,
        needs: Mapping[str, Collection[str]],
        ahead: int,
        deadline: float,
        watch: Watch,
        pace: Pace = NO_PACE,
    ) -> None:
        """Let workers run some ticks ahead; a silence may last as long as the deadline, s.

        `needs` are the workers whose samples each worker needs.
        """
        self.spent = Spent()
        self.recording = 0.0
        """s of wall time."""
        self._clock, self._target, self._workers, self._recorder = clock, target, workers, recorder
        self._needs = needs
        self._ahead, self._deadline, self._watch = ahead, deadline, watch
        self._pace = pace

    def run(self) -> Iterator[int]:
        """Close the ticks after the last that is recorded; yield each number, or the last of some.

        Some are closed at once where the workers tell them at once.
        """
        first = self._recorder.closed + 1
        self._target.skip_to(first - 1)
        self._target.publish_until(first - 1 + self._ahead)
        self._pace.start(self._clock.t(max(first - 1, 0)))
        k = first
        while k <= self._clock.ticks:
            self._workers.advance(k, k if self._pace.asked else max(k, self._target.published))
            self._gather(k)
            self._pace.wait(self._clock.t(k), partial(self._look_around, k))
            began = perf_counter()
            self._recorder.close(k)
            k = self._recorder.closed
            self.recording += perf_counter() - began
            # By half windows: a few ticks' samples cost hardly more than one's.
            if self._target.published < k + (self._ahead + 1) // 2:
                self._target.publish_until(k + self._ahead)
            self._watch(self._clock.t(k))
            yield k
            k += 1

    def _gather(self, k: int) -> None:
        recorder = self._recorder
        began, waited = perf_counter(), 0.0
        taken, since = recorder.taken, monotonic()
        while not recorder.is_whole(k):
            asked = perf_counter()
            items = self._workers.inbox.take() or self._workers.inbox.take(_PATIENCE)
            waited += perf_counter() - asked
            self._take(items)
            if recorder.is_whole(k):
                break
            here = self._look_around(k)
            # Silence counts where all workers are there; one that is started again has --wait.
            if recorder.taken != taken or not here:
                taken, since = recorder.taken, monotonic()
            elif monotonic() - since >= self._deadline:
                # What a worker failed with says more than the silence that follows from it.
                self._workers.look_after(k, at_last=True)
                raise BusError(self._silence(k), Cause("deadline", k))
        self.spent.waiting += waited
        self.spent.bus += perf_counter() - began - waited

    def _take(self, items: Sequence[Item]) -> None:
        for item in items:
            if isinstance(item, Message) and item.key.startswith(_BATCHES):
                self._recorder.take(item)
            else:
                self._workers.handle(item)

    def _look_around(self, k: int) -> bool:
        """See to what came, the user, and the workers; return whether all of these are there."""
        self._take(self._workers.inbox.take())
        self._watch(self._clock.t(max(k - 1, 0)))
        return self._workers.look_after(k)

    def _silence(self, k: int) -> str:
        """Say who is silent at tick k, and what each of them waits for."""
        lacks = self._recorder.missing(k)
        waiting = [self._waits(worker) for worker in sorted(lacks)]
        return f"tick {k} did not close in {self._deadline:g} s of silence: {'; '.join(waiting)}"

    def _waits(self, worker: str) -> str:
        last = self._recorder.last_received(worker)
        lacks = self._recorder.missing(last)
        others = sorted(h for h in self._needs.get(worker, ()) if SAMPLES in lacks.get(h, ()))
        who = (
            "the target"
            if worker == TARGET
            else f"{named(self._workers.assignment[worker])} on worker {worker}"
        )
        if others:
            return f"{who} sent samples up to tick {last} and lack those of {', '.join(others)}"
        return f"{who} sent samples up to tick {last} and wait for none: computing, or stopped"
