"""A recording is put back on the bus for live tools: the very bytes, each on its own key.

Message by message in total order, on `nrs/<the digest's first 16 digits><topic>`; reliable, and
blocking rather than dropping. Each says which protobuf message it is, and who asks on
`nrs/<…>/@schema/<its name>` is answered with the FileDescriptorSet that defines it. Simulated time
is paced by the wall clock, or not at all.
"""

from collections.abc import Callable
from time import monotonic

from nrs_cosim.bus.clock import NS_PER_S
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.recordings.mcap.reader import Reader

Wait = Callable[[float], None]
"""Waits for so many s."""

PROTOBUF, SCHEMA = "application/protobuf", "@schema"
EVERY_KEY = "**"


def key_of(topic: str) -> str:
    """Return the key of a topic below the run's own: Zenoh has none that begins with a slash."""
    return topic.lstrip("/")


def publish(
    reader: Reader,
    endpoints: Endpoints,
    *,
    speed: float | None,
    start_ns: int | None,
    end_ns: int | None,
    ready: Callable[[ZenohBus], None],
    wait: Wait,
) -> int:
    """Put a recording's messages of start_ns <= log time < end_ns; return how many.

    `speed` is simulated over wall time, None for as fast as possible. `ready` is called when the
    keys are declared, before the first message.
    """
    bus = ZenohBus(reader.digest_here[:16], endpoints)
    try:
        for schema in reader.schemas:
            bus.offer(f"{SCHEMA}/{schema.name}", schema.data)
        puts = {
            channel.topic: bus.publisher(key_of(channel.topic), f"{PROTOBUF};{channel.schema_name}")
            for channel in reader.channels
        }
        ready(bus)
        count, began, first = 0, monotonic(), None
        for batch in reader.batches(None, start_ns, end_ns):
            for time_ns, topic, _, data in batch:
                first = time_ns if first is None else first
                if speed:
                    due = began + (time_ns - first) / NS_PER_S / speed
                    if due > monotonic():
                        wait(due - monotonic())
                puts[topic](data)
                count += 1
        return count
    finally:
        bus.close()
