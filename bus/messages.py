"""A message is a protobuf record of fixed size, so that many are coded in one step.

All message types open with the same three fields, with explicit presence: proto3 then writes
them even when they are zero, and a message of dimension m always has the same length and the same
bytes between its numbers. The declaration below is the only one: the protobuf descriptor that goes
into recordings and the NumPy dtype that codes the bytes are both derived from it. A blob alone has
any size.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from struct import Struct
from typing import Any

import numpy as np
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from numpy.typing import NDArray

from nrs_cosim.bus.errors import BusError

HEADER = Struct("<xIxIxQ")
"""Robot, k and time_ns, at the start of each message."""

_FIXED64, _BYTES, _FIXED32 = 1, 2, 5
_SCALARS = (
    ("robot", "<u4", _FIXED32, FieldDescriptorProto.TYPE_FIXED32),
    ("k", "<u4", _FIXED32, FieldDescriptorProto.TYPE_FIXED32),
    ("time_ns", "<u8", _FIXED64, FieldDescriptorProto.TYPE_FIXED64),
)
_COMMENTS = {
    "robot": "the robot's number, from 1; 0 is the target",
    "k": "the tick that closes this message's interval",
    "time_ns": "simulated time, ns",
    "data": "the plant's state and the estimator's, of this version's own form",
}
_MESSAGE_TYPE, _FIELD = 4, 2
"""Of FileDescriptorProto and DescriptorProto, for the paths of comments."""


@dataclass(frozen=True, slots=True)
class MessageType:
    """A protobuf message: robot, k and time_ns (ns), further scalars, vectors of m doubles each.

    At most 12 scalars and vectors, so that every field number fits the one-byte tag.
    """

    name: str
    vectors: tuple[str, ...]
    further: tuple[str, ...] = ()
    """Scalars of 32 bits, unsigned."""
    comments: Mapping[str, str] = field(default_factory=dict, hash=False)
    """What a reader of the schema is told of each vector and further scalar."""

    @property
    def scalars(self) -> tuple[tuple[str, str, int, FieldDescriptorProto.Type.ValueType], ...]:
        """Name, dtype, wire type and protobuf type of each scalar, in the order of the fields."""
        _, dtype, wire, kind = _SCALARS[0]
        return _SCALARS + tuple((name, dtype, wire, kind) for name in self.further)

    def descriptor(self) -> bytes:
        """Return the serialised protobuf `FileDescriptorSet` that describes this type."""
        file = FileDescriptorProto(
            name=f"{self.name.replace('.', '/')}.proto",
            package=self.name.rpartition(".")[0],
            syntax="proto3",
        )
        message = file.message_type.add(name=self.name.rpartition(".")[2])
        for number, (name, _, _, kind) in enumerate(self.scalars, start=1):
            message.oneof_decl.add(name=f"_{name}")
            message.field.add(
                name=name,
                number=number,
                type=kind,
                label=FieldDescriptorProto.LABEL_OPTIONAL,
                proto3_optional=True,
                oneof_index=number - 1,
            )
        for number, name in enumerate(self.vectors, start=len(self.scalars) + 1):
            message.field.add(
                name=name,
                number=number,
                type=FieldDescriptorProto.TYPE_DOUBLE,
                label=FieldDescriptorProto.LABEL_REPEATED,
            )
        _comment(file, {**_COMMENTS, **self.comments})
        return FileDescriptorSet(file=[file]).SerializeToString()


def _comment(file: FileDescriptorProto, comments: Mapping[str, str]) -> None:
    """Put comments on the fields of a file's only message, as protoc keeps them."""
    for number, declared in enumerate(file.message_type[0].field):
        file.source_code_info.location.add(
            path=[_MESSAGE_TYPE, 0, _FIELD, number],
            span=[number, 0, 0],
            leading_comments=f" {comments[declared.name]}\n",
        )


SAMPLE = MessageType(
    "nrs.Sample",
    ("position", "velocity"),
    comments={
        "position": "estimate of the target's position at t_k, left limit; of the target its own",
        "velocity": "estimate of the target's velocity at t_k, left limit; of the target its own",
    },
)
"""ε_i(t_k), υ_i(t_k) of robot i, left limits, in the target's units; robot 0 is the target."""

STATE = MessageType(
    "nrs.State",
    ("position", "velocity", "effort", "reference_position", "reference_velocity"),
    comments={
        "position": "of each joint: rad, or m of one that slides",
        "velocity": "of each joint: rad/s or m/s",
        "effort": "applied to each joint by the PD law: N m or N",
        "reference_position": "estimate of the target's position, which the robot follows",
        "reference_velocity": "estimate of the target's velocity, which the robot follows",
    },
)
"""Robot i's q, q̇, applied torque, and ε_i, υ_i at one time; k is the tick that closes it.

The first three are named as in ROS's JointState; the reference is what the robot follows.
"""

LINK_EVENT = MessageType(
    "nrs.LinkEvent",
    ("position", "velocity"),
    ("source", "lost", "outage", "delay"),
    {
        "source": "the node whose sample it is; the robot itself where that is in an outage",
        "lost": "1 when the link lost the sample",
        "outage": "1 when the link or one of its ends was in an outage",
        "delay": "sampling periods by which the sample is late",
        "position": "what arrives, zeros when nothing does",
        "velocity": "what arrives, zeros when nothing does",
    },
)
"""What the link from node `source` to robot i did to the sample of t_k.

`lost` and `outage` are 0 or 1; `delay` is in sampling periods, also of a sample that never
arrives; position and velocity are what arrives, zeros when nothing does. A message whose source is
the robot itself says that the robot is in an outage.
"""


class Codec:
    """Codes a message type for vectors of m numbers: n messages as one array of n records."""

    def __init__(self, kind: MessageType, m: int) -> None:
        self.kind = kind
        self.m = m
        layout: list[tuple[Any, ...]] = []
        for name, dtype, _, _ in kind.scalars:
            layout += [(f"tag_{name}", "u1"), (name, dtype)]
        self._length = _varint(8 * m)
        for name in kind.vectors:
            layout += [(f"tag_{name}", "u1"), (f"len_{name}", "u1", len(self._length))]
            layout += [(name, "<f8", (m,))]
        self.dtype = np.dtype(layout)
        self.size = self.dtype.itemsize

    @cached_property
    def _template(self) -> NDArray[np.uint8]:
        """(size,) bytes of a message of zeros; made when there are messages, for it may be long."""
        blank = np.zeros(1, self.dtype)
        for number, (name, _, wire, _) in enumerate(self.kind.scalars, start=1):
            blank[f"tag_{name}"] = number << 3 | wire
        for number, name in enumerate(self.kind.vectors, start=len(self.kind.scalars) + 1):
            blank[f"tag_{name}"] = number << 3 | _BYTES
            blank[f"len_{name}"] = np.frombuffer(self._length, np.uint8)
        return blank.view(np.uint8)

    @cached_property
    def _fixed(self) -> NDArray[np.bool_]:
        """(size,) whether a byte is the same in every message."""
        fixed = np.ones(self.size, bool)
        for name in (*(name for name, *_ in self.kind.scalars), *self.kind.vectors):
            column, offset = self.dtype.fields[name][:2]  # type: ignore[index]
            fixed[offset : offset + column.itemsize] = False
        return fixed

    def blank(self, robots: NDArray[np.integer]) -> NDArray[np.void]:
        """Return records for the given robots (n,), all else zero, to be filled at each tick."""
        records = np.tile(self._template, len(robots)).view(self.dtype)
        records["robot"] = robots
        return records

    def encode(self, records: NDArray[np.void]) -> list[bytes]:
        """Return each record's bytes, as they travel."""
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
                    f"{self.m} numbers it has {self.size}"
                )
        return self.parsed(b"".join(payloads))

    def parsed(self, data: bytes) -> NDArray[np.void]:
        """Return messages that follow one another as records (n,); `BusError` as `decode`."""
        raw = np.frombuffer(data, np.uint8).reshape(-1, self.size)
        records = raw.reshape(-1).view(self.dtype)
        if not (raw[:, self._fixed] == self._template[self._fixed]).all():
            raise BusError(f"a message that is no {self.kind.name} was refused")
        for name in self.kind.vectors:
            finite = np.isfinite(records[name])
            if not finite.all():
                bad = records[~finite.all(axis=1)][0]
                raise BusError(
                    f"a {self.kind.name} was refused: {name} of robot {bad['robot']} at "
                    f"k = {bad['k']} is {bad[name].tolist()}, not finite"
                )
        return records


_TAGS = tuple(number << 3 | wire for number, (_, _, wire, _) in enumerate(_SCALARS, start=1))
_BLOB_HEAD = Struct("<BIBIBQ")
"""As `HEADER`, with the tags of the three fields."""
_DATA = len(_SCALARS) + 1


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
        files = FileDescriptorSet.FromString(MessageType(self.name, ()).descriptor())
        files.file[0].message_type[0].field.add(
            name="data",
            number=_DATA,
            type=FieldDescriptorProto.TYPE_BYTES,
            label=FieldDescriptorProto.LABEL_OPTIONAL,
        )
        files.file[0].ClearField("source_code_info")
        _comment(files.file[0], _COMMENTS)
        return files.SerializeToString()

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
        for size in range(2, min(len(rest), 7)):
            if rest[:size] == _data_of(len(rest) - size):
                return Blob(robot, k, time_ns, rest[size:])
        raise BusError(
            f"a {self.name} of robot {robot} at k = {k} was refused: its data are not whole"
        )


CHECKPOINT = BlobType("nrs.Checkpoint")
"""From which robot i goes on after t_k, as its plant has it."""


def _data_of(length: int) -> bytes:
    """Return what stands before the data of a blob."""
    return bytes([_DATA << 3 | _BYTES]) + _varint(length)


def _varint(value: int) -> bytes:
    """Return the base-128 varint of a length (protobuf encoding, 'Length-delimited records')."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)
