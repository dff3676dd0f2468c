"""Messages per second that are written and read, beside mcap's and Foxglove's writers in one run.

All write the same ticks of encoded samples and states, with zstd in chunks of 64 KiB, and hand each
message over from Python. Ours sorts each tick, digests it, and leaves a file that after a SIGKILL
has all but the chunk being filled; with `flush` every complete tick. The others lose the
chunk being filled. All take turns, so that a noisy machine is noisy to all of them.
"""

import statistics
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory

import foxglove
from foxglove import Channel, Context
from foxglove import Schema as FoxgloveSchema
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from mcap.reader import make_reader

from benchmarks.table import keep
from benchmarks.writers import CODECS, Ticks, mcaps, ours, ours_flushed, ticks_of
from nrs_cosim.recordings.channels import channels, schemas
from nrs_cosim.recordings.export.tables import SAMPLES, STATES, rows
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import CHUNK_BYTES

ROUNDS = 7
SIZES = {6: 1500, 100: 100}
"""Robots, and the ticks of one timed file."""


def foxgloves(path: Path, n: int, ticks: Ticks) -> None:
    """Write by foxglove-sdk's writer, which is Rust; it numbers the messages itself."""
    context = Context()
    options = MCAPWriteOptions(compression=MCAPCompression.Zstd, chunk_size=CHUNK_BYTES)
    with foxglove.open_mcap(path, context=context, writer_options=options):
        used = channels(CODECS, n, (), False)
        types = {
            s.name: FoxgloveSchema(name=s.name, encoding="protobuf", data=s.data)
            for s in schemas(used, CODECS)
        }
        log = {
            c.topic: Channel(
                c.topic, message_encoding="protobuf", schema=types[c.schema_name], context=context
            ).log
            for c in used
        }
        for tick in ticks:
            for t, topic, _, data in tick:
                log[topic](data, log_time=t)


def read_arrays(path: Path) -> int:
    """Read all samples and states as arrays."""
    with Reader(path) as reader:
        return sum(len(found) for _, found in rows(reader, [SAMPLES, STATES]))


def read_messages(path: Path) -> int:
    """Read all messages, as they were written."""
    with Reader(path) as reader:
        return sum(map(len, reader.batches()))


def read_by_mcap(path: Path) -> int:
    """Read by the `mcap` package's reader."""
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages(log_time_order=False))


WRITERS = {
    "ours": ours,
    "ours, each tick": ours_flushed,
    "mcap": mcaps,
    "foxglove-sdk": foxgloves,
}
READERS = {"arrays": read_arrays, "messages": read_messages, "mcap": read_by_mcap}


def timed(work: Callable[[], object]) -> float:
    """Return the seconds that it takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def measure(n: int, count: int, folder: Path) -> dict[str, dict[str, float]]:
    """Return the messages per second of each writer and reader, medians."""
    ticks = ticks_of(n, count)
    messages = sum(map(len, ticks))
    took: dict[tuple[str, str], list[float]] = defaultdict(list)
    for i in range(ROUNDS):
        for name, write in WRITERS.items():
            path = folder / f"{n} {name} {i}.mcap"
            took["written", name].append(timed(lambda: write(path, n, ticks)))  # noqa: B023 (called at once)
        for name, read in READERS.items():
            path = folder / f"{n} ours {i}.mcap"
            took["read", name].append(timed(lambda: read(path)))  # noqa: B023 (called at once)
            assert read(path) == messages
    rates: dict[str, dict[str, float]] = {"written": {}, "read": {}}
    for (done, name), times in took.items():
        rates[done][name] = messages / statistics.median(times)
    return rates


def main() -> None:
    """Print the tables, and write them as JSON beside."""
    results = {}
    with TemporaryDirectory() as folder:
        for n, count in SIZES.items():
            results[n] = measure(n, count, Path(folder))
    for done in ("written", "read"):
        names = list(results[6][done])
        print(f"messages {done} per second, {ROUNDS} interleaved rounds; beside the fastest\n")
        print(f"{'robots':>7}" + "".join(f"{name:>24}" for name in names))
        for n, rates in results.items():
            best = max(rates[done].values())
            cells = (f"{rate:,.0f} ({best / rate:.2f} x)" for rate in rates[done].values())
            print(f"{n:>7}" + "".join(f"{cell:>24}" for cell in cells))
        print()
    keep("recordings", results)


if __name__ == "__main__":
    main()
