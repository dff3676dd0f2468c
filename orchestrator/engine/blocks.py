"""A worker that is alone does ticks by native code, and tells the recorder some of them at once.

At each tick its samples are put on the bus and received, as ever; what is received must be the very
bytes that were put, and whatever else comes is left to those who judge it. What is recorded of a
block of ticks is one batch. A block ends before a checkpoint, and before a tick at which something
fails: it is told first. It is no longer than `MOST_BYTES` of messages or `MOST_SECONDS` of wall
time, and has one tick at least, also where the process got no time: nobody waits for a block of
none.
"""

from time import perf_counter

import numpy as np

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.keys import RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.transport import Bus, Inbox, Message, Side
from nrs_cosim.bus.validation import TickBlock, Wire
from nrs_cosim.orchestrator.engine.native.whole_tick import WholeTick
from nrs_cosim.orchestrator.engine.worker import Watch, Worker

MOST_BYTES, MOST_SECONDS = 64 * 1024, 0.05


def most_ticks(wire: Wire, robots: int) -> int:
    """Return how many ticks a block of robots may have."""
    outputs = len(wire.times.outputs(1))
    return max(1, MOST_BYTES // (robots * (wire.samples.size + outputs * wire.states.size)))


class Blocks:
    """Does blocks of a worker's ticks; `Worker.run` does the others."""

    def __init__(
        self,
        worker: Worker,
        tick: WholeTick,
        most: int,
        bus: Bus,
        inbox: Inbox,
        ears: Side,
        wire: Wire,
        clock: Clock,
    ) -> None:
        """Do up to `most` ticks; worker and recorder have each a side of the inbox."""
        self._worker, self._tick, self._most = worker, tick, most
        self._inbox, self._ears, self._wire, self._clock = inbox, ears, wire, clock
        self._outputs = len(worker.agents.robots) * len(clock.outputs(1))
        self._own, self._target = (wire_key(SAMPLES, name) for name in (worker.name, TARGET))
        self._put_samples = bus.publisher(self._own)
        self._put_records = bus.publisher(wire_key(RECORDS, worker.name))
        self._ahead: dict[int, bytes] = {}
        """The target's records that came before their time, by k."""
        self._failure: Exception | None = None

    def does(self, k: int) -> bool:
        """Return whether tick k can be of a block; if not, let the worker have what came for it."""
        if k and not self._worker.is_checkpoint(k):
            return True
        for tick, record in self._ahead.items():
            self._ears.add(Message(self._target, tick.to_bytes(4, "little") + record))
        self._ahead.clear()
        return False

    def run(self, first: int, until: int, watch: Watch) -> None:
        """Do the ticks from `first` to `until`, or fewer, and tell them.

        What a tick fails with is raised once those before it are told: when that one is asked for.
        """
        if self._failure:
            raise self._failure
        self._tick.take_up()
        received: list[bytes] = []
        began, last = perf_counter(), first - 1
        due = began + MOST_SECONDS
        end = min(until, first + self._most - 1)
        if every := self._worker.checkpoints_every:
            end = min(end, (first // every + 1) * every - 1)
        try:
            while last < end and (last < first or perf_counter() < due):
                received += self._do(last + 1, last + 1 - first, watch)
                last += 1
        except Exception as error:
            if last < first:
                raise
            self._failure = error
        self._worker.spent.plants += perf_counter() - began
        self._tick.hand_over()
        states = self._tick.states[: (last + 1 - first) * self._outputs]
        samples = np.frombuffer(b"".join(received), self._wire.samples.dtype)
        block = TickBlock(first, last, states.copy(), samples)
        self._put_records(self._wire.pack_block(self._worker.name, block))

    def _do(self, k: int, place: int, watch: Watch) -> tuple[bytes, bytes]:
        """Do a tick, which has a place in its block; return its records: the target's, its own."""
        worker, tick, times = self._worker, self._tick, self._clock.outputs(k)
        worker.now = k
        reached = held = self._clock.t(k - 1)
        for slot, t in enumerate(times, place * len(times)):
            if not tick.advance(
                seconds(reached),
                seconds(t - reached),
                seconds(t - held),
                k,
                t,
                slot,
                holds=reached == held,
                sends=t == times[-1],
            ):
                worker.left = tick.left()
                worker.expect_bounded(t)
            reached = t
            watch(t)
        samples = tick.samples.tobytes()
        self._put_samples(samples)
        target = self._received(k, samples)
        tick.jump(k, target, samples)
        return target, samples[4:]

    def _received(self, k: int, samples: bytes) -> bytes:
        """Take what came until what was put is among it; return the target's record of t_k."""
        own = False
        for item in self._inbox.take():
            if isinstance(item, Message):
                key, payload = item
                if key == self._own and payload == samples and not own:
                    own = True
                    continue
                if key == self._target and self._keeps(k, payload):
                    continue
            self._ears.add(item)
        target = self._ahead.pop(k, None)
        if target is None and (records := self._worker.target_ahead(k)) is not None:
            target = records.tobytes()
        if not own or target is None:
            raise BusError(f"tick {k}: no samples came from {TARGET if own else self._worker.name}")
        return target

    def _keeps(self, k: int, payload: bytes) -> bool:
        """Return whether a batch has the target's samples of t_k or later, and nobody had them."""
        samples = self._wire.own_samples(TARGET, payload)
        if samples is None:
            return False
        first, size = int(samples["k"][0]), self._wire.samples.size
        if first < k or first in self._ahead:
            return False
        data = samples.tobytes()
        for row in range(len(samples)):
            self._ahead[first + row] = data[row * size : (row + 1) * size]
        return True
