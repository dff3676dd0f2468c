"""The bytes of our codec against protobuf's own runtime, built from the descriptor we publish."""

import struct
from hashlib import sha256

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.messages import (
    CHECKPOINT,
    HEADER,
    LINK_EVENT,
    SAMPLE,
    STATE,
    Blob,
    BlobType,
    Codec,
    MessageType,
)

RNG = np.random.default_rng(7)


def protobuf_class(kind: MessageType | BlobType):
    """Return the message class that protobuf itself makes of our descriptor."""
    files = descriptor_pb2.FileDescriptorSet.FromString(kind.descriptor())
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(kind.name))


def filled(kind: MessageType, m: int, robots: list[int]) -> tuple[Codec, np.ndarray]:
    codec = Codec(kind, Sizes(m))
    records = codec.blank(np.array(robots))
    records["k"], records["time_ns"] = 12, 1_200_000_000
    for number, name in enumerate(kind.counts):
        records[name] = 70_000 * number
    for name in kind.fields:
        records[name] = RNG.normal(size=(len(robots), m))
    return codec, records


@pytest.mark.parametrize("kind", [SAMPLE, STATE, LINK_EVENT], ids=lambda kind: kind.name)
@pytest.mark.parametrize("m", [1, 2, 15, 16, 300])
def test_bytes_are_those_of_protobuf(kind, m):
    codec, records = filled(kind, m, [0, 1, 70_000])
    records[next(iter(kind.fields))][1] = 0.0
    records[list(kind.fields)[1]][2] = -0.0
    message_class = protobuf_class(kind)
    for record, payload in zip(records, codec.encode(records), strict=True):
        theirs = message_class(
            robot=int(record["robot"]),
            k=12,
            time_ns=1_200_000_000,
            **{name: int(record[name]) for name in kind.counts},
            **{name: record[name].tolist() for name in kind.fields},
        )
        assert payload == theirs.SerializeToString(deterministic=True)
        read = message_class.FromString(payload)
        assert [getattr(read, name) for name in kind.counts] == [
            70_000 * number for number in range(len(kind.counts))
        ]
        assert struct.pack(f"{m}d", *getattr(read, list(kind.fields)[1])) == (
            record[list(kind.fields)[1]].tobytes()
        )


def test_a_header_of_zeros_is_written():
    codec = Codec(SAMPLE, Sizes(2))
    (payload,) = codec.encode(codec.blank(np.array([0])))
    assert HEADER.unpack_from(payload) == (0, 0, 0)
    assert payload == protobuf_class(SAMPLE)(
        robot=0, k=0, time_ns=0, position=[0, 0], velocity=[0, 0]
    ).SerializeToString(deterministic=True)


def test_decode_gives_back_every_bit():
    codec, records = filled(STATE, 3, [4, 2])
    decoded = codec.decode(codec.encode(records))
    assert decoded.tobytes() == records.tobytes()
    assert decoded["robot"].tolist() == [4, 2]


def test_wrong_size_is_refused():
    codec, records = filled(SAMPLE, 2, [1])
    (payload,) = codec.encode(records)
    with pytest.raises(BusError, match=r"nrs\.Sample of 54 bytes was refused.*it has 55"):
        codec.decode([payload, payload[:-1]])


def test_other_message_of_the_same_size_is_refused():
    codec, records = filled(SAMPLE, 2, [1])
    payload = bytearray(codec.encode(records)[0])
    payload[0] ^= 0x80
    with pytest.raises(BusError, match=r"no nrs\.Sample was refused"):
        codec.decode([bytes(payload)])


@pytest.mark.parametrize("number", [np.nan, np.inf, -np.inf])
def test_non_finite_number_is_refused_and_named(number):
    codec, records = filled(SAMPLE, 2, [1, 5])
    records["velocity"][1, 0] = number
    with pytest.raises(BusError, match=r"velocity of robot 5 at k = 12 is .*not finite"):
        codec.decode(codec.encode(records))


@pytest.mark.parametrize("size", [0, 1, 127, 128, 16_383, 16_384, 2_100_000])
def test_a_blob_of_any_size_is_valid_protobuf(size):
    for robot, k, time_ns in ((0, 0, 0), (70_000, 2**32 - 1, 2**64 - 1)):
        blob = Blob(robot, k, time_ns, RNG.bytes(size))
        theirs = protobuf_class(CHECKPOINT)(robot=robot, k=k, time_ns=time_ns, data=blob.data)
        payload = CHECKPOINT.encode(blob)
        assert payload == theirs.SerializeToString(deterministic=True)
        assert HEADER.unpack_from(payload) == (robot, k, time_ns)
        assert CHECKPOINT.decode(payload) == blob


def test_the_fields_of_a_blob_are_declared():
    (file,) = descriptor_pb2.FileDescriptorSet.FromString(CHECKPOINT.descriptor()).file
    (message,) = file.message_type
    assert (file.package, message.name) == ("nrs", "Checkpoint")
    result = [(field.name, field.number, field.proto3_optional) for field in message.field]
    assert result == [("robot", 1, True), ("k", 2, True), ("time_ns", 3, True), ("data", 4, False)]


def test_a_blob_that_is_cut_or_is_another_message_is_refused():
    payload = CHECKPOINT.encode(Blob(3, 12, 5, RNG.bytes(200)))
    for cut in range(len(payload)):
        words = "no nrs.Checkpoint" if cut < HEADER.size else "robot 3 at k = 12 .* not whole"
        if cut == HEADER.size:
            continue
        with pytest.raises(BusError, match=words):
            CHECKPOINT.decode(payload[:cut])
    _, records = filled(SAMPLE, 2, [1])
    for other in (*Codec(SAMPLE, Sizes(2)).encode(records), b"\0" + payload[1:], payload + b"\0"):
        with pytest.raises(BusError, match="refused"):
            CHECKPOINT.decode(other)


@pytest.mark.parametrize("kind", [SAMPLE, STATE, LINK_EVENT, CHECKPOINT], ids=lambda k: k.name)
def test_every_field_has_a_comment_where_protobuf_looks_for_it(kind):
    (file,) = descriptor_pb2.FileDescriptorSet.FromString(kind.descriptor()).file
    of = {tuple(at.path): at.leading_comments for at in file.source_code_info.location}
    fields = file.message_type[0].field
    # descriptor.proto: 4 is message_type of a file, 2 is field of a message
    assert set(of) == {(4, 0, 2, number) for number in range(len(fields))}
    assert all(comment.strip() for comment in of.values())


SCHEMAS = {
    SAMPLE: "dfffffd65300b6a90eab282e396203fa751eb241ead98f8a0b6b050385eb740a",
    STATE: "53c1e5970f2841ece8e9ca09413259a9cc8d3b58a9a637b7949f4feace198451",
    LINK_EVENT: "69c8fb66b627f3b510042be8994903ce7b0da7be00f9e17993d99f681ec70c76",
    CHECKPOINT: "7652774335824c050bcc55ebd1f86883aa2d86e92a368389dfded3e7f63b9be1",
}


@pytest.mark.parametrize("kind", SCHEMAS, ids=lambda kind: kind.name)
def test_a_standing_type_has_one_schema_for_good(kind):
    """Recordings hold it; another one is another type, of another name."""
    assert sha256(kind.descriptor()).hexdigest() == SCHEMAS[kind]
