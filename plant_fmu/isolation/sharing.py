"""What a process shares with the workers that step its robots: memory, and frames on a pipe.

Numbers travel in a file that all of them map: references in, states out, a row a robot. A frame
says only what to do with them, or how that ended: a kind, the length of what follows, and it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from struct import Struct
from typing import IO

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.drives.choice import Driving, Undriven
from nrs_cosim.plant_fmu.isolation.progress import SIZE, Progress
from nrs_cosim.plant_fmu.plants import Array, Body

HEAD = Struct("=cI")
ADVANCE, ADVANCED_BY = b"a", Struct("=Bdd")
"""How many parts of new references there are, none where they stay; start and step in s."""
SAVE, RESTORE = b"c", b"r"
"""The robots' checkpoints are asked for, or given, framed as `bus.framing` has it."""
DONE, BAD_FMU, BAD_STEP = b"d", b"f", b"s"
"""An answer; the last two with the text of an `FmuError` or a `StepError`."""

ROBOT = Struct("<I")
"""What stands before such a text: the robot that it is of, 0 for none."""


def envelope(kind: bytes, payload: bytes = b"") -> bytes:
    """Return a frame."""
    return HEAD.pack(kind, len(payload)) + payload


def send(pipe: IO[bytes], whole: bytes) -> None:
    """Write a frame to an unbuffered pipe, which takes what it has room for at a time."""
    rest = memoryview(whole)
    while rest:
        rest = rest[pipe.write(rest) :]


@dataclass(frozen=True, slots=True, eq=False)
class ShareTask:
    """What one worker is told at its start."""

    archive: Archive
    bodies: Sequence[Body]
    names: Mapping[str, Spec]
    driving: Driving | Undriven
    memory: Path
    place: tuple[int, int, int]
    """Its first row, and the numbers of all robots and of all workers."""
    worker: int
    threads: int
    """How many step them."""
    representatives: Sequence[Body] = ()
    """See `open_plants`."""


class Memory:
    """A mapped file: a `Progress` for each worker, then the robots' numbers."""

    def __init__(self, path: Path, workers: int, threads: int, n: int, m: int) -> None:
        """Map a file, which grows to its size, with zeros, when it is new; threads of a worker."""
        size = threads * SIZE
        head = workers * size // 8
        numbers = np.asarray(np.memmap(path, np.float64, "r+", shape=(head + 6 * n * m,)))
        progress = numbers[:head].data.cast("B")
        self.progress = [Progress(progress[i * size : (i + 1) * size]) for i in range(workers)]
        rows = numbers[head:].reshape(6, n, m)
        self.reference: Array = rows[:3]
        """(3, n, m) ε_i(t⁺), υ_i(t⁺), and the acceleration"""
        self.q: Array = rows[3]
        self.qd: Array = rows[4]
        self.tau: Array = rows[5]
