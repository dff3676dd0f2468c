"""A checkpoint is parts, each after its length: plain bytes and doubles, nothing to be executed."""

import struct
from collections.abc import Sequence

import numpy as np

from plant_fmu.errors import FmuError
from plant_fmu.plants import Array


def join(parts: Sequence[bytes]) -> bytes:
    """Return parts as one."""
    return b"".join(struct.pack("<Q", len(part)) + part for part in parts)


def split(data: bytes, count: int) -> list[bytes]:
    """Return what was joined; `FmuError` unless it is that many parts and no more."""
    parts, at = [], 0
    while at + 8 <= len(data):
        (length,) = struct.unpack_from("<Q", data, at)
        parts.append(data[at + 8 : at + 8 + length])
        at += 8 + length
    if at != len(data) or len(parts) != count:
        raise FmuError(f"the checkpoint is not one of these plants: expected {count} whole parts")
    return parts


def doubles(*values: Array | float) -> bytes:
    """Return numbers as bytes."""
    return np.concatenate([np.ravel(value) for value in values]).astype("<f8").tobytes()


def numbers(part: bytes, count: int) -> Array:
    """Return a part's numbers; `FmuError` unless there are that many."""
    if len(part) != 8 * count:
        raise FmuError(
            f"the checkpoint is not one of these plants: expected {count} numbers, "
            f"got {len(part) // 8}"
        )
    return np.frombuffer(part, "<f8").astype(float)
