"""A run whose robots are all in the orchestrator's own process and thread, with no socket open."""

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import Any, Never
from uuid import uuid4

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.keys import RECORDS, SAMPLES, wire_key
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Bus, Item, tee
from nrs_cosim.bus.validation import Wire
from nrs_cosim.orchestrator.engine.blocks import Blocks, most_ticks
from nrs_cosim.orchestrator.engine.lockstep import Launcher, Workers
from nrs_cosim.orchestrator.engine.restart import AT_ONCE, point_of
from nrs_cosim.orchestrator.engine.robots import Robots, wire_of
from nrs_cosim.orchestrator.engine.worker import ReceivedSamples, Spent, Watch, Worker
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.recorder import Recorder

NAME = "here"
_ROBOTS_A_THREAD = 16
"""At least: else it costs more to wake a thread than it saves."""


class InProcess:
    """The only worker of a run; see `orchestrator.engine.lockstep.Workers`."""

    def __init__(self, bus: Bus, robots: Robots, watch: Watch) -> None:
        self.assignment = {NAME: robots.numbers}
        inbox = bus.listen(wire_key(SAMPLES, "*"), wire_key(RECORDS, "*"))
        self.inbox, self._received = tee(inbox)
        self.rejected: Counter[str] = Counter()
        self.restarts = 0
        self._wire = wire_of(robots.experiment, self.assignment, Signer(), in_process=True)
        self._worker: Worker = robots.worker(NAME, bus, self._received, self._wire)
        self._robots, self._watch, clock = robots, watch, robots.experiment.clock
        self._ticks: Iterator[int] = iter(())
        most, outputs = most_ticks(self._wire, len(robots.numbers)), len(clock.outputs(1))
        tick = robots.whole_tick(self._wire, most * outputs)
        self._blocks: Blocks | None = None
        self.numpy_why = self.steps_why = ""
        """Why NumPy does the ticks, if so; why native code that does them does not step plants."""
        if isinstance(tick, str):
            self.numpy_why = tick
        else:
            self.steps_why = tick.steps_why
            hearing = bus, inbox, self._received
            self._blocks = Blocks(self._worker, tick, most, *hearing, self._wire, clock)

    def wire(self) -> Wire:
        """Return the wire between the worker and the recorder."""
        return self._wire

    def describe_plants(self) -> Sequence[Mapping[str, Any]]:
        """Return what the user is told of the plants, by group."""
        return self._robots.plant_descriptions

    def spent(self) -> dict[str, Spent]:
        """Return where the time of the worker went."""
        return {NAME: self._worker.spent}

    def begin(self, recorder: Recorder) -> None:
        """Begin where a recording ends: at the checkpoint, and then through what it has."""
        point = point_of(self._robots.numbers, recorder.checkpoints, recorder.closed)
        if point.start:
            self._worker.restore(point.start, point.checkpoints)
        self._recorded = _RecordedSamples(recorder)
        self._ticks = self._worker.run(point.recorded, self._watch, self._recorded)
        # What the recording has is run through at once, and nothing of it is sent.
        if point.recorded >= 0:
            while next(self._ticks) < point.recorded:
                pass

    def advance(self, k: int, until: int) -> None:
        """Do the next tick, and perhaps more at once up to `until`."""
        if self._blocks and self._blocks.does(k):
            self._worker.take_in(k, self._received.pending(), self._recorded)
            self._blocks.run(k, until, self._watch)
        else:
            next(self._ticks)

    def handle(self, item: Item) -> Never:
        """Refuse what nobody can have put."""
        raise BusError(f"a message that no worker sent: {item}")

    def look_after(self, k: int, at_last: bool = False) -> bool:  # noqa: ARG002
        """Return that the worker is there."""
        return True

    def end(self) -> None:
        """Do nothing: the worker ends with the run."""


class _RecordedSamples:
    """In one thread nothing comes while the worker waits: the recording has it, or nobody."""

    patience = 0.0

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def lack(self, k: int, missing: Sequence[str]) -> Iterable[ReceivedSamples]:
        """Return the samples that the recording has; `BusError` when it has none of tick k."""
        if k > self._recorder.closed:
            raise BusError(f"tick {k}: no samples came from {', '.join(missing)}")
        return self._recorder.samples(k, k + AT_ONCE - 1)

    def handle(self, item: Item) -> Iterable[ReceivedSamples]:  # noqa: ARG002
        """Pass over what no worker of the run put; the recorder counts it."""
        return ()


def threads_worth_it(n: int, processes: int = 1) -> int:
    """Return with how many threads of each process n robots' FMUs are best stepped here."""
    return max(1, min((os.cpu_count() or 1) // processes, n // processes // _ROBOTS_A_THREAD))


def in_process(experiment: Experiment, threads: int = 1) -> Launcher:
    """Return how a run gets all its robots into this thread, whose FMUs several may step."""

    def launch(stack: ExitStack, watch: Watch) -> tuple[Bus, Workers]:
        robots = Robots.opened(stack, experiment, range(1, experiment.n + 1), threads=threads)
        return on_a_session(stack, robots, watch)

    return launch


def on_a_session(stack: ExitStack, robots: Robots, watch: Watch) -> tuple[Bus, Workers]:
    """Return robots in this thread on a session of their own; the stack ends it."""
    bus = ZenohBus(uuid4().hex)
    stack.callback(bus.close)
    return bus, InProcess(bus, robots, watch)
