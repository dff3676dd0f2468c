"""A message is a protobuf record of fixed size, so that many are coded in one step.

All message types open with the same three fields, with explicit presence: proto3 then writes
them even when they are zero, and a message always has the same length and the same bytes between
its numbers. The declaration below is the only one: the protobuf descriptor that goes into
recordings (`bus.descriptors`) and the NumPy dtype that codes the bytes are both derived from it.
Arrays are flat in protobuf, the last axis fastest; their shapes stand beside the schema. A blob
alone has any size.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from math import prod
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.fields import Field, Shape, Sizes

HEADER = Struct("<xIxIxQ")
"""Robot, k and time_ns, at the start of each message."""

FIXED64, BYTES, FIXED32 = 1, 2, 5
"""Wire types."""
COMMENTS = {
    "robot": "the robot's number, from 1; 0 is the target",
    "k": "the tick that closes this message's interval",
    "time_ns": "simulated time, ns",
    "data": "the plant's state and the estimator's, of this version's own form",
}
"""What the fields that all messages have mean, and a blob's data."""


@dataclass(frozen=True, slots=True)
class Count:
    """A whole number of a message, unsigned: of 32 bits, but for `time_ns`."""

    doc: str = ""
    bits: int = 32


OPENING: Mapping[str, Count] = {
    "robot": Count(COMMENTS["robot"]),
    "k": Count(COMMENTS["k"]),
    "time_ns": Count(COMMENTS["time_ns"], 64),
}
"""What every message type begins with."""


@dataclass(frozen=True, slots=True)
class MessageType:
    """A protobuf message: robot, k and time_ns (ns), then counts and fields by name."""

    name: str
    entries: Mapping[str, Field | Count] = field(hash=False)
    """In the order of their field numbers, from 4 on."""

    @property
    def numbered(self) -> list[tuple[int, str, Field | Count]]:
        """Number, name and kind of all that a message has."""
        return [(number, *entry) for number, entry in enumerate(self._all().items(), 1)]

    @property
    def fields(self) -> dict[str, Field]:
        """What doubles it has."""
        return {name: of for name, of in self.entries.items() if isinstance(of, Field)}

    @property
    def counts(self) -> tuple[str, ...]:
        """What whole numbers it has beside the first three."""
        return tuple(name for name, of in self.entries.items() if isinstance(of, Count))

    def descriptor(self) -> bytes:
        """Return the serialised protobuf `FileDescriptorSet` that describes this type."""
        from nrs_cosim.bus.descriptors import of_message  # noqa: PLC0415, it loads protobuf

        return of_message(self)

    def _all(self) -> dict[str, Field | Count]:
        return {**OPENING, **self.entries}


SAMPLE = MessageType(
    "nrs.Sample",
    {
        "position": Field(
            truth="position",
            doc="estimate of the target's position at t_k, left limit; of the target its own",
        ),
        "velocity": Field(
            truth="velocity",
            doc="estimate of the target's velocity at t_k, left limit; of the target its own",
        ),
    },
)
"""ε_i(t_k), υ_i(t_k) of robot i, left limits, in the target's units; robot 0 is the target."""

STATE = MessageType(
    "nrs.State",
    {
        "position": Field(doc="of each joint: rad, or m of one that slides"),
        "velocity": Field(doc="of each joint: rad/s or m/s"),
        "effort": Field(doc="applied to each joint by the PD law: N m or N"),
        "reference_position": Field(
            truth="position", doc="estimate of the target's position, which the robot follows"
        ),
        "reference_velocity": Field(
            truth="velocity", doc="estimate of the target's velocity, which the robot follows"
        ),
    },
)
"""Robot i's q, q̇, applied torque, and ε_i, υ_i at one time; k is the tick that closes it.

The first three are named as in ROS's JointState; the reference is what the robot follows.
"""

MEASUREMENT = MessageType(
    "nrs.Measurement",
    {
        "position": Field(truth="position", doc="as the robot measures the target's position"),
        "velocity": Field(truth="velocity", doc="as the robot measures the target's velocity"),
    },
)
"""What robot i, pinned at t_k, measures of the target then, before its link does anything."""

LINK_EVENT = MessageType(
    "nrs.LinkEvent",
    {
        "source": Count("the node whose sample it is; the robot itself where that is in an outage"),
        "lost": Count("1 when the link lost the sample"),
        "outage": Count("1 when the link or one of its ends was in an outage"),
        "delay": Count("sampling periods by which the sample is late"),
        "position": Field(doc="what arrives, zeros when nothing does"),
        "velocity": Field(doc="what arrives, zeros when nothing does"),
    },
)
"""What the link from node `source` to robot i did to the sample of t_k.

`lost` and `outage` are 0 or 1; `delay` is in sampling periods, also of a sample that never
arrives; position and velocity are what arrives, zeros when nothing does. A message whose source is
the robot itself says that the robot is in an outage.
"""


class Codec:
    """Codes a message type for the sizes of a run: n messages as one array of n records."""

    def __init__(self, kind: MessageType, sizes: Sizes) -> None:
        self.kind = kind
        self.sizes = sizes
        self.shapes = {name: field.size(sizes) for name, field in kind.fields.items()}
        """Of each field, in numbers."""
        layout: list[tuple[Any, ...]] = []
        self._constant: dict[str, bytes] = {}
        """Of each stretch between the numbers its bytes; its name is that of no field."""
        for number, name, entry in kind.numbered:
            opening, column = _layout(number, entry, self.shapes.get(name, ()))
            self._constant[f"{name}.tag"] = opening
            layout += [(f"{name}.tag", "u1", (len(opening),)), (name, *column)]
        self.dtype = np.dtype(layout)
        self.size = self.dtype.itemsize

    @cached_property
    def _template(self) -> NDArray[np.uint8]:
        """(size,) bytes of a message of zeros; made when there are messages, for it may be long."""
        blank = np.zeros(1, self.dtype)
        for name, opening in self._constant.items():
            blank[name] = np.frombuffer(opening, np.uint8)
        return blank.view(np.uint8)

    @cached_property
    def _fixed(self) -> NDArray[np.bool_]:
        """(size,) whether a byte is the same in every message."""
        fixed = np.zeros(self.size, bool)
        for name, opening in self._constant.items():
            _, offset = self.dtype.fields[name][:2]  # type: ignore[index]
            fixed[offset : offset + len(opening)] = True
        return fixed

    def blank(self, robots: NDArray[np.integer]) -> NDArray[np.void]:
        """Return records for the given robots (n,), all else zero, to be filled at each tick."""
        records = np.tile(self._template, len(robots)).view(self.dtype)
        records["robot"] = robots
        return records

    def encode(self, records: NDArray[np.void]) -> list[bytes]:
        """Return the bytes of each of the records (n,), as they travel."""
        raw, size = records.tobytes(), self.size
        return [raw[at : at + size] for at in range(0, len(raw), size)]

    def decode(self, payloads: list[bytes]) -> NDArray[np.void]:
        """Return the messages as records (n,).

        Raises `BusError` when one has another size, other fields or a non-finite number.
        """
        for payload in payloads:
            if len(payload) != self.size:
                raise BusError(
                    f"a {self.kind.name} of {len(payload)} bytes was refused: with vectors of "
                    f"{self.sizes.m} numbers it has {self.size}"
                )
        return self.parsed(b"".join(payloads))

    def parsed(self, data: bytes) -> NDArray[np.void]:
        """Return messages that follow one another as records (n,); `BusError` as `decode`."""
        raw = np.frombuffer(data, np.uint8).reshape(-1, self.size)
        records = raw.reshape(-1).view(self.dtype)
        if not (raw[:, self._fixed] == self._template[self._fixed]).all():
            raise BusError(f"a message that is no {self.kind.name} was refused")
        for name in self.shapes:
            finite = np.isfinite(records[name])
            if not finite.all():
                bad = records[~finite.reshape(len(records), -1).all(axis=1)][0]
                raise BusError(
                    f"a {self.kind.name} was refused: {name} of robot {bad['robot']} at "
                    f"k = {bad['k']} is {bad[name].tolist()}, not finite"
                )
        return records


def _layout(number: int, entry: Field | Count, shape: Shape) -> tuple[bytes, tuple[Any, ...]]:
    """Return the bytes before a field's numbers, and the dtype and shape of these."""
    if isinstance(entry, Count):
        wire = FIXED64 if entry.bits > 32 else FIXED32
        return _varint(number << 3 | wire), (f"<u{entry.bits // 8}",)
    if not entry.shape:
        return _varint(number << 3 | FIXED64), ("<f8",)
    return _varint(number << 3 | BYTES) + _varint(8 * prod(shape)), ("<f8", shape)


_TAGS = tuple(
    number << 3 | (FIXED64 if entry.bits > 32 else FIXED32)
    for number, entry in enumerate(OPENING.values(), 1)
)
_BLOB_HEAD = Struct("<BIBIBQ")
"""As `HEADER`, with the tags of the three fields."""
DATA = len(OPENING) + 1


@dataclass(frozen=True, slots=True)
class Blob:
    """What a message of a `BlobType` holds."""

    robot: int
    k: int
    time_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class BlobType:
    """A protobuf message of any size: robot, k and time_ns (ns), then bytes."""

    name: str

    def descriptor(self) -> bytes:
        """Return the serialised protobuf `FileDescriptorSet` that describes this type."""
        from nrs_cosim.bus.descriptors import of_blob  # noqa: PLC0415, as above

        return of_blob(self)

    def encode(self, blob: Blob) -> bytes:
        """Return a message's bytes, as they travel; proto3 does not write data that are empty."""
        header = zip(_TAGS, (blob.robot, blob.k, blob.time_ns), strict=True)
        opening = _data_of(len(blob.data)) if blob.data else b""
        return _BLOB_HEAD.pack(*(n for field in header for n in field)) + opening + blob.data

    def decode(self, payload: bytes) -> Blob:
        """Return what a message holds; `BusError` when it is cut or has other fields."""
        if len(payload) < HEADER.size or _BLOB_HEAD.unpack_from(payload)[::2] != _TAGS:
            raise BusError(f"a message that is no {self.name} was refused")
        robot, k, time_ns = HEADER.unpack_from(payload)
        rest = payload[HEADER.size :]
        if not rest:
            return Blob(robot, k, time_ns, b"")
        # A tag, and a length of 1 to 5 bytes, which has room for 32 GiB.
        for size in range(2, min(len(rest), 7)):
            if rest[:size] == _data_of(len(rest) - size):
                return Blob(robot, k, time_ns, rest[size:])
        raise BusError(
            f"a {self.name} of robot {robot} at k = {k} was refused: its data are not whole"
        )


CHECKPOINT = BlobType("nrs.Checkpoint")
"""From which robot i goes on after t_k, as its plant has it."""

STANDING_TYPES: tuple[MessageType | BlobType, ...] = (
    SAMPLE,
    STATE,
    MEASUREMENT,
    LINK_EVENT,
    CHECKPOINT,
)
"""The message types that no algorithm declares."""


def _data_of(length: int) -> bytes:
    """Return what stands before the data of a blob."""
    return bytes([DATA << 3 | BYTES]) + _varint(length)


def _varint(value: int) -> bytes:
    """Return the base-128 varint of a length (protobuf encoding, 'Length-delimited records')."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
