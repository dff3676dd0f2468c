"""What a robot-interval takes at least: what is left when everything but the matter itself is free.

    FMU arithmetic    the FMUs' steps: a native round of steps and reads, less one of reads
    Zenoh             a batch of samples a tick, put and received
    copied once       the messages, from one place in memory to another
    SHA-256           of what the digest is over
    zstd              of the messages as records, a chunk at a time
    CRC-32            of the same, and of the file
    file              what is written, handed to the operating system

All of it is processor time, the least of some rounds, on the bytes of a real recording.
"""

import hashlib
import zlib
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory
from time import thread_time

import numpy as np

from benchmarks.measured import recorded, zenoh_put_and_received
from benchmarks.work import H, Motion, keep_motion, scenario
from nrs_cosim.orchestrator.engine.robots import Robots
from nrs_cosim.recordings.mcap.chunk import _COMPRESS
from nrs_cosim.recordings.mcap.reader import Reader

ROUNDS = 5
PUTS, SAMPLE_BYTES = 1_000, 59


def floor(n: int, ticks: int) -> dict[str, float]:
    """Return the microseconds of a robot-interval that each part takes at least, and their sum."""
    with TemporaryDirectory(prefix="nrs-") as name:
        folder = Path(name)
        path, kept = folder / "run.mcap", folder / "motion.npz"
        recorded(n, ticks, 1, path)
        keep_motion(scenario(n, ticks), path, kept)
        motion = Motion(kept)
        steps = min(arithmetic(n, ticks, motion) for _ in range(ROUNDS))
        batch = bytes(n * SAMPLE_BYTES)
        bus = min(zenoh_put_and_received(PUTS, batch)["cpu"] for _ in range(ROUNDS)) / PUTS * ticks
        parts = {"FMU arithmetic": steps, "Zenoh": bus, **of_bytes(path)}
    found = {part: seconds / (n * ticks) * 1e6 for part, seconds in parts.items()}
    return {**found, "floor": sum(found.values())}


def arithmetic(n: int, ticks: int, motion: Motion) -> float:
    """Return the seconds of the FMUs' steps alone, over the motion that was recorded."""
    with ExitStack() as stack:
        robots = Robots.opened(stack, scenario(n, ticks), range(1, n + 1))
        (plants,) = robots.plants.plants
        stepping = reading = 0.0
        for k, references in enumerate(motion.references):
            plants.hold(references[:, :2], references[:, 2:])
            began = thread_time()
            plants.step(k / 10, H)
            stepped = thread_time()
            plants.read()
            stepping, reading = stepping + stepped - began, reading + thread_time() - stepped
        motion.expect(plants.state)
    return stepping - reading


def of_bytes(path: Path) -> dict[str, float]:
    """Return the seconds that the bytes of a recording take, part by part."""
    with Reader(path) as reader:
        topics = {number: len(topic) for number, topic in reader.topics.items()}
        chunks = list(reader.columns(reader.topics.values()))
    messages = sum(int((chunk.stop - chunk.start).sum()) for chunk in chunks)
    heads = sum(sum(24 + topics[on] for on in chunk.channel.tolist()) for chunk in chunks)
    records, written = [bytes(chunk.data) for chunk in chunks], path.read_bytes()
    target = np.empty(messages, np.uint8)
    source, digested = np.ones(messages, np.uint8), bytes(messages + heads)

    def write() -> None:
        with path.with_suffix(".again").open("wb", buffering=0) as file:
            file.write(written)

    return {
        "copied once": least(lambda: np.copyto(target, source)),
        "SHA-256": least(lambda: hashlib.sha256(digested)),
        "zstd": least(lambda: [_COMPRESS["zstd"](data) for data in records]),
        "CRC-32": least(lambda: [zlib.crc32(data) for data in (*records, written)]),
        "file": least(write),
    }


def least(work: Callable[[], object]) -> float:
    """Return the least processor time, s, of some rounds."""
    took = []
    for _ in range(ROUNDS):
        began = thread_time()
        work()
        took.append(thread_time() - began)
    return min(took)
