"""A recording is put back on the bus for live tools, each message on a key of its own.

As it is: the very bytes, in total order, on `nrs/<the digest's first 16 digits><topic>`. Each says
which protobuf message it is, and who asks on `nrs/<…>/@schema/<its name>` is answered with the
FileDescriptorSet that defines it. Or as messages of ROS 2, what a bag of it has, as a node `nrs`.

Puts are reliable, and block rather than drop. Simulated time is paced by the wall clock, or not at
all.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from time import monotonic

from nrs_cosim.bus.clock import NS_PER_S
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.ros_node import RosNode
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.transport import Put
from nrs_cosim.recordings.mcap.container import Message
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.ros2.conversion import Conversion

Wait = Callable[[float], None]
"""Waits for so many s."""

PROTOBUF, SCHEMA = "application/protobuf", "@schema"
EVERY_KEY = "**"
NODE = "nrs"


def key_of(topic: str) -> str:
    """Return the key of a topic below the run's own: Zenoh has none that begins with a slash."""
    return topic.lstrip("/")


@dataclass(frozen=True, slots=True)
class Publication:
    """What is put, in order, where each topic goes, and how to know that somebody listens."""

    pattern: str
    """All its keys."""
    puts: dict[str, Put]
    messages: Iterator[list[Message]]
    wait_for_listener: Callable[[float], bool]
    """Waits for so many s at most; returns whether somebody listens."""

    def publish(self, speed: float | None, wait: Wait) -> int:
        """Put all messages; return how many.

        `speed` is simulated over wall time, None for as fast as possible.
        """
        count, began, first = 0, monotonic(), None
        for batch in self.messages:
            for time_ns, topic, _, data in batch:
                first = time_ns if first is None else first
                if speed:
                    due = began + (time_ns - first) / NS_PER_S / speed
                    if due > monotonic():
                        wait(due - monotonic())
                self.puts[topic](data)
                count += 1
        return count


@contextmanager
def as_recorded(
    reader: Reader, endpoints: Endpoints, start_ns: int | None = None, end_ns: int | None = None
) -> Iterator[Publication]:
    """Yield a recording's messages of start_ns <= log time < end_ns, on keys that are declared."""
    bus = ZenohBus(reader.digest_here[:16], endpoints)
    try:
        for schema in reader.schemas:
            bus.offer(f"{SCHEMA}/{schema.name}", schema.data)
        puts = {
            channel.topic: bus.publisher(key_of(channel.topic), f"{PROTOBUF};{channel.schema_name}")
            for channel in reader.channels
        }
        yield Publication(
            f"nrs/{bus.run_id}/{EVERY_KEY}",
            puts,
            reader.batches(None, start_ns, end_ns),
            lambda seconds: bus.wait_for_listener(EVERY_KEY, seconds),
        )
    finally:
        bus.close()


@contextmanager
def as_ros2(
    reader: Reader,
    endpoints: Endpoints,
    start_ns: int | None = None,
    end_ns: int | None = None,
    *,
    domain: int = 0,
    epoch_ns: int = 0,
) -> Iterator[Publication]:
    """Yield the same in messages of ROS 2, on the keys of a domain; t = 0 is at an epoch."""
    made, node = Conversion(reader, None, epoch_ns), RosNode(NODE, domain, endpoints)
    try:
        puts = {
            topic.name: node.publisher(
                topic.name, topic.type.name, topic.type.hash, latched=topic.latched
            )
            for topic in made.topics
        }
        topics = {number: topic.name for number, topic in enumerate(made.topics, 1)}
        stretches = made.stretches(start_ns, end_ns)
        messages = (stretch.messages(topics) for stretch in stretches)
        yield Publication(node.pattern, puts, messages, node.wait_for_listener)
    finally:
        node.close()
