"""A robot's checkpoint is its own: its FMU's digest, its numbers, the time first, its FMU's state.

It says nothing of other robots, so that those that were saved together go on in any company. It is
plain bytes and doubles, nothing to be executed.
"""

from collections.abc import Iterable, Sequence
from struct import Struct

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Array

HEAD = Struct("<32sII")
"""The FMU's sha256, how many doubles follow, and how many bytes of its state follow them."""
_TIME = Struct("<d")


def encode(archive: Archive, numbers: Iterable[Array], states: Sequence[bytes]) -> list[bytes]:
    """Return the checkpoints of robots' numbers (count,), of which the first is the time."""
    digest = bytes.fromhex(archive.sha256)
    return [
        HEAD.pack(digest, row.size, len(state)) + row.astype("<f8").tobytes() + state
        for row, state in zip(numbers, states, strict=True)
    ]


def decode(
    archive: Archive, robots: Sequence[int], data: Sequence[bytes], counts: Sequence[int]
) -> tuple[list[Array], list[bytes]]:
    """Return what was encoded of some robots: their so many numbers (count,), and FMU states.

    `FmuError` where one is not of this FMU, or not whole, and where `time_of` has it.
    """
    time_of(data, len(robots))
    digest = bytes.fromhex(archive.sha256)
    values: list[Array] = []
    states: list[bytes] = []
    for robot, row, count in zip(robots, data, counts, strict=True):
        after = HEAD.size + 8 * count
        whose, numbers, length = HEAD.unpack_from(row)
        what = f"{archive.label}: the checkpoint given to robot {robot}"
        if whose != digest:
            raise FmuError(
                f"{what} is of an FMU with sha256 {whose.hex()}, this one has {archive.sha256}"
            )
        if numbers != count:
            raise FmuError(
                f"{what} has {numbers} numbers, expected {count}: it is driven otherwise"
            )
        if len(row) != after + length:
            raise FmuError(f"{what} has {len(row)} bytes, expected {after + length}")
        values.append(np.frombuffer(row[HEAD.size : after], "<f8").astype(float))
        states.append(row[after:])
    return values, states


def time_of(data: Sequence[bytes], n: int) -> float:
    """Return the time of n robots' checkpoints in s; `FmuError` unless all are of one."""
    if len(data) != n:
        raise FmuError(f"got checkpoints of {len(data)} robots, expected {n}")
    short = next((row for row in data if len(row) < HEAD.size + _TIME.size), None)
    if short is not None:
        raise FmuError(f"a checkpoint of {len(short)} bytes is not whole")
    times = sorted({_TIME.unpack_from(row, HEAD.size)[0] for row in data})
    if len(times) > 1:
        raise FmuError(
            f"checkpoints of one time are needed, got some of t = {times[0]:g} s and some of "
            f"t = {times[-1]:g} s"
        )
    return float(times[0])
