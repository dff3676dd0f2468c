"""Byte strings as one: each after its length, u32 little-endian."""

from collections.abc import Iterable
from struct import Struct

_LENGTH = Struct("<I")


def joined(parts: Iterable[bytes]) -> bytes:
    """Return parts as one."""
    return b"".join([piece for part in parts for piece in (_LENGTH.pack(len(part)), part)])


def parted(data: bytes) -> list[bytes] | None:
    """Return what was joined; None when it is not whole parts."""
    parts, at = [], 0
    while at + _LENGTH.size <= len(data):
        (length,) = _LENGTH.unpack_from(data, at)
        at += _LENGTH.size
        parts.append(data[at : at + length])
        at += length
    return parts if at == len(data) else None
