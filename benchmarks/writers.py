"""Ticks of encoded messages, as workers say them, and writers that take them one by one."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import topic_of
from nrs_cosim.bus.messages import SAMPLE, STATE, Codec
from nrs_cosim.orchestrator.engine.native.arranging import load_arranging
from nrs_cosim.recordings.channels import channels, schemas
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import Message
from nrs_cosim.recordings.mcap.ordering import columns_of
from nrs_cosim.recordings.mcap.writer import CHUNK_BYTES, Writer
from nrs_cosim.recordings.metadata import RUN

H = 100_000_000
"""ns"""
CODECS = Codecs.of(Sizes(2))

Ticks = list[list[Message]]


def ticks_of(n: int, count: int) -> Ticks:
    """Return ticks of samples and of states at two times, of arms that move smoothly."""
    made: Ticks = [[] for _ in range(count)]
    for kind, robots, kind_name in ((SAMPLE, n + 1, "sample"), (STATE, n, "state")):
        codec, first = Codec(kind, Sizes(2)), n + 1 - robots
        numbers = np.arange(first, n + 1)
        records = codec.blank(numbers)
        for k, tick in enumerate(made):
            for t in (k * H + H // 2, k * H + H)[kind is SAMPLE :]:
                records["k"], records["time_ns"] = k, t
                for name in kind.fields:
                    records[name] = np.sin(np.outer(numbers + 0.1, [t / 1e9, t / 2e9]))
                encoded = zip(numbers.tolist(), codec.encode(records), strict=True)
                tick.extend((t, topic_of(kind_name, robot), k, data) for robot, data in encoded)
    return made


def as_columns(n: int, ticks: Ticks) -> list[Columns]:
    """Return the same ticks as runs hand them over: columns, on the channels of n robots."""
    numbers = {
        channel.topic: number for number, channel in enumerate(channels(CODECS, n, (), False), 1)
    }
    return [columns_of(tick, numbers) for tick in ticks]


@contextmanager
def recording(path: Path, n: int) -> Iterator[Writer]:
    """Open this project's writer for n robots, and finish what it wrote."""
    used = channels(CODECS, n, (), False)
    about = {RUN: {"robots": str(n), "joints": "2"}}
    with Writer(
        path,
        version="0",
        channels=used,
        schemas=schemas(used, CODECS),
        metadata=about,
        attachments={},
        arranging=load_arranging(),
    ) as writer:
        yield writer
        writer.finish("completed")


def ours(path: Path, n: int, ticks: Ticks) -> None:
    """Write by this project's writer, message by message."""
    with recording(path, n) as writer:
        for tick in ticks:
            writer.write(tick)


def ours_flushed(path: Path, n: int, ticks: Ticks) -> None:
    """The same, and every tick is in the file when the next one begins."""
    with recording(path, n) as writer:
        for tick in ticks:
            writer.write(tick)
            writer.flush()


def ours_of_columns(path: Path, n: int, ticks: Sequence[Columns]) -> None:
    """Write by this project's writer, as runs do."""
    with recording(path, n) as writer:
        for tick in ticks:
            writer.put([tick])


def mcaps(path: Path, n: int, ticks: Ticks) -> None:
    """Write by the `mcap` package's writer."""
    with path.open("wb") as file:
        writer = McapWriter(file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start("nrs", "benchmark")
        used = channels(CODECS, n, (), False)
        ids = {
            s.name: writer.register_schema(s.name, "protobuf", s.data)
            for s in schemas(used, CODECS)
        }
        numbers = {
            c.topic: writer.register_channel(c.topic, "protobuf", ids[c.schema_name]) for c in used
        }
        for tick in ticks:
            for t, topic, k, data in tick:
                writer.add_message(numbers[topic], t, data, t, k)
        writer.finish()
