"""What two workers of one robot each put, made up, and a writer that keeps ticks at hand."""

import numpy as np

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.messages import CHECKPOINT, Blob
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Message
from nrs_cosim.bus.validation import Tick, Wire
from nrs_cosim.recordings.channels import channels
from nrs_cosim.recordings.recorder import Recorder

M, H = 2, 100_000_000
ROBOTS = {"left": 1, "right": 2}
ASSIGNMENT = {worker: [robot] for worker, robot in ROBOTS.items()}


def wire_of(ticks: int) -> Wire:
    """Return the wire of a run of two robots and the target."""
    assignment = {worker: np.array(robots) for worker, robots in ASSIGNMENT.items()}
    return Wire(
        Codecs.of(Sizes(M)), Clock((H,), 1, ticks), {**assignment, TARGET: np.array([0])}, Signer()
    )


def samples(wire: Wire, worker: str, k: int, value: float = 1.0) -> Message:
    """Return what a worker, or the target, puts of its samples of t_k."""
    records = wire.samples.blank(wire.assignment[worker])
    records["k"], records["time_ns"], records["position"] = k, wire.times.t(k), value
    return Message(wire_key(SAMPLES, worker), wire.pack_samples(worker, k, records))


def tick_batch(
    wire: Wire, worker: str, k: int, *, value=1.0, faults=0, checkpoint=False
) -> Message:
    """Return what a worker puts of all else of a tick."""
    states = wire.states.blank(wire.assignment[worker])
    states["k"], states["time_ns"], states["position"] = k, wire.times.t(k), value
    met = wire.link_events.blank(np.repeat(wire.assignment[worker], faults))
    met["k"], met["time_ns"], met["lost"] = k, wire.times.t(k), 1
    blobs = (
        [CHECKPOINT.encode(Blob(ROBOTS[worker], k, wire.times.t(k), b"s"))] if checkpoint else []
    )
    return Message(wire_key(RECORDS, worker), wire.pack_tick(worker, k, Tick(states, met, blobs)))


def whole(wire: Wire, k: int, **what) -> list[Message]:
    """Return all that tick k consists of."""
    put = [samples(wire, worker, k) for worker in (*ROBOTS, TARGET) if k]
    return [*put, *(tick_batch(wire, worker, k, **what) for worker in ROBOTS)]


class Kept:
    """A writer that keeps what is put: see `recordings.recorder.TickWriter`."""

    path = "nowhere"

    def __init__(self, faulty=(), checkpoints=False) -> None:
        topics = [
            channel.topic for channel in channels(Codecs.of(Sizes(M)), 2, faulty, checkpoints)
        ]
        self.numbers = {topic: number for number, topic in enumerate(topics, 1)}
        self._topics = {number: topic for topic, number in self.numbers.items()}
        self.ticks = []

    def put(self, tick) -> None:
        """Keep a tick as (topic, time, k) of its messages, in order."""
        messages = [message for part in tick for message in part.messages(self._topics)]
        self.ticks.append(sorted((topic, time, k) for time, topic, k, _ in messages))

    def flush(self) -> None:
        """Do nothing."""


def recorder_of(wire: Wire, *, keep=8, faulty=(), checkpoints=False) -> tuple[Recorder, Kept]:
    """Return a recorder of such a run, and the writer that it writes to."""
    writer = Kept(faulty, checkpoints)
    return Recorder(writer, wire, 2, keep), writer
