"""Records that stand in a chunk, written by hand, and which of them are messages."""

import struct

import numpy as np
import pytest

from nrs_cosim.recordings.mcap.columns import Columns, columns, put_rows
from nrs_cosim.recordings.mcap.container import DamageError

CHANNELS = (1, 7)


def record(channel, data, *, kind=5, length=None):
    """Return a message of MCAP: opcode, length, channel, sequence, two times, and its bytes."""
    body = struct.pack("<HIQQ", channel, 3, 40, 40) + data
    return struct.pack("<BQ", kind, len(body) if length is None else length) + body


WHOLE = record(1, b"abc") + record(7, b"") + record(1, b"defg")


def test_messages_are_found_with_their_fields():
    found = columns(WHOLE, CHANNELS)
    assert found.channel.tolist() == [1, 7, 1]
    assert found.sequence.tolist() == [3, 3, 3]
    assert found.time.tolist() == [40, 40, 40]
    assert [found.payload(row) for row in range(3)] == [b"abc", b"", b"defg"]
    assert found.messages({1: "a", 7: "b"}) == [
        (40, "a", 3, b"abc"),
        (40, "b", 3, b""),
        (40, "a", 3, b"defg"),
    ]


@pytest.mark.parametrize("like", [None, [31], [31, 65, 96], [31, 9999]], ids=str)
@pytest.mark.parametrize(
    "damaged",
    [
        record(1, b"abc") + record(1, b"abc", kind=6) + record(1, b"d"),
        record(1, b"abc", kind=4) + record(1, b"d"),
        record(1, b"abc") + struct.pack("<BQ", 5, 21) + bytes(21) + record(1, b"d"),
        record(1, b"abc") + record(2, b"abc"),
        record(1, b"abc")[:-1],
        WHOLE + b"\x05",
        WHOLE + struct.pack("<BQ", 5, 4) + bytes(4),
        record(1, b"abc", length=2**63),
        record(1, b"abc", length=2**64 - 1) + WHOLE,
    ],
    ids=[
        "another opcode between",
        "another opcode first",
        "a message shorter than its head",
        "a channel that there is not",
        "cut",
        "a byte more",
        "the last shorter than its head",
        "a length beyond all",
        "a length that turns over",
    ],
)
def test_a_malformed_message_is_damage(damaged, like):
    guess = None if like is None else np.array(like)
    with pytest.raises(DamageError):
        columns(damaged, CHANNELS, guess)


def test_no_records_give_no_messages():
    assert len(columns(b"", CHANNELS).channel) == 0


def test_only_requested_messages_are_read():
    data = b"".join(
        struct.pack("<BQHIQQ", 5, 23, channel, k, t, t) + b"x"
        for k, (channel, t) in enumerate([(1, 10), (7, 20), (1, 30), (7, 40)])
    )
    found = columns(data, CHANNELS)
    assert found.on([7]).sequence.tolist() == [1, 3]
    assert found.on([1, 7]) is found
    assert found.within(20, 40).sequence.tolist() == [1, 2]
    assert found.within(10, 41) is found
    assert found.payloads(1) == b"xxxx"
    with pytest.raises(DamageError, match="a message has another size"):
        found.payloads(2)


def test_stretches_of_several_sizes_are_copied_to_their_places():
    into = bytearray(b"........")
    starts, sizes = np.array([0, 3, 5]), np.array([3, 0, 2])
    put_rows(memoryview(into), np.array([5, 0, 1]), b"abcdefg", starts, sizes)
    assert into == b".fg..abc"


def test_rows_may_be_taken_by_number():
    found = columns(WHOLE, CHANNELS).at(np.array([2, 0]))
    assert isinstance(found, Columns)
    assert [found.payload(row) for row in range(2)] == [b"defg", b"abc"]
