"""Ticks are put in total order or not at all; what is put is read again."""

import threading

import numpy as np
import pytest
from mcap.reader import make_reader

from nrs_cosim.recordings.errors import UncreatableError, UnwritableError
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import Channel, Schema
from nrs_cosim.recordings.mcap.ordering import columns_of
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer

CHANNELS = [Channel(topic, "T") for topic in ("b", "a", "c")]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "a.mcap"


def new(path, **options):
    return Writer(
        path,
        version="1",
        channels=CHANNELS,
        schemas=[Schema("T", b"")],
        metadata={},
        attachments={},
        **options,
    )


def all_of(path):
    with Reader(path, verify=True) as reader:
        assert reader.damage == []
        return list(reader.messages())


def test_what_channels_say_alike_is_in_memory_once(path):
    units = [{"unit.position": '["rad"]'}, {"unit.position": '["m"]'}]
    channels = [Channel(f"/{at}", "T", metadata=dict(units[at > 7])) for at in range(9)]
    with Writer(
        path, version="1", channels=channels, schemas=[Schema("T", b"")], metadata={},
        attachments={},
    ) as writer:  # fmt: skip
        writer.finish("completed")
    with Reader(path) as reader:
        assert reader.channels == tuple(channels)
        assert len({id(channel.metadata) for channel in reader.channels}) == 2


def test_an_empty_tick_writes_nothing(path):
    message = (5, "a", 1, b"x")
    none = columns_of([message], {"a": 2}).at(np.zeros(1, bool))
    assert isinstance(none, Columns)
    with new(path) as writer:
        for tick in ([], [none], [none, columns_of([message], writer.numbers), none], [none], []):
            writer.put(tick)
        writer.write([])
        writer.finish("completed")
    assert all_of(path) == [message]


@pytest.mark.parametrize(
    ("first", "then", "follows"),
    [
        ((5, "b"), (5, "c"), True),
        ((5, "b"), (5, "b"), False),
        ((5, "b"), (5, "a"), False),
        ((5, "b"), (6, "a"), True),
        ((5, "b"), (4, "c"), False),
    ],
)
def test_a_tick_begins_after_the_one_before_by_time_and_topic(path, first, then, follows):
    with new(path) as writer:
        writer.write([(*first, 1, b"x")])
        if follows:
            writer.write([(*then, 2, b"y")])
        else:
            with pytest.raises(ValueError, match=r"a tick begins at .* not after") as caught:
                writer.write([(*then, 2, b"y")])
            assert f"begins at {then}, not after {first}" in str(caught.value)
        writer.finish("completed")
    expected = [(*first, 1, b"x")] + [(*then, 2, b"y")] * follows
    assert all_of(path) == expected


def test_order_is_by_the_last_message_of_a_tick_and_the_first_of_the_next(path):
    early, late = (3, "c", 1, b""), (5, "a", 1, b"")
    with new(path) as writer:
        writer.write([late, early])
        with pytest.raises(ValueError, match=r"begins at \(4, 'c'\), not after \(5, 'a'\)"):
            writer.write([(9, "a", 2, b""), (4, "c", 2, b"")])
        writer.write([(9, "a", 2, b""), (5, "b", 2, b"")])
        writer.finish("completed")
    assert all_of(path) == [early, late, (5, "b", 2, b""), (9, "a", 2, b"")]


@pytest.mark.parametrize(
    "message",
    [(5, "d", 1, b""), (-1, "a", 1, b""), (2**64, "a", 1, b""), (5, "a", 2**32, b"")],
)
def test_messages_that_do_not_fit_are_refused_with_the_file(path, message):
    with new(path) as writer:
        with pytest.raises(ValueError, match=r"a\.mcap: "):
            writer.write([(5, "a", 1, b""), message])
        writer.finish("completed")
    assert all_of(path) == []


@pytest.mark.parametrize("options", [{"chunk_bytes": 1}, {"chunk_seconds": 0.0}], ids=str)
def test_a_chunk_closes_at_the_end_of_a_tick_when_it_is_large_or_old(path, options):
    ticks = [[(k, "a", k, b"x"), (k, "b", k, b"y")] for k in range(1, 5)]
    with new(path, **options) as writer:
        for tick in ticks:
            writer.write(tick)
        writer.finish("completed")
    with Reader(path) as reader:
        assert [len(batch) for batch in reader.batches()] == [2, 2, 2, 2]
    assert all_of(path) == [message for tick in ticks for message in tick]


def test_a_finished_writer_refuses_more(path):
    with new(path) as writer:
        writer.finish("completed")
        for act in (
            lambda: writer.put([]),
            lambda: writer.write([(5, "a", 1, b"")]),
            lambda: writer.finish("completed"),
        ):
            with pytest.raises(UnwritableError, match="is closed"):
                act()
    assert all_of(path) == []


def test_a_file_that_cannot_be_created_is_reported(tmp_path):
    with pytest.raises(UncreatableError, match="cannot be created"):
        new(tmp_path / "none" / "a.mcap")


@pytest.mark.parametrize(
    ("status", "extra"),
    [("perfect", {}), ("completed", {"digest": "0"}), ("failed", {"ticks": ""})],
)
def test_an_unknown_ending_is_refused_and_writing_continues(path, status, extra):
    with new(path) as writer:
        with pytest.raises(ValueError, match="status"):
            writer.finish(status, "", extra)
        writer.write([(5, "a", 1, b"")])
        writer.finish("completed", "", {"more": "1"})
    assert len(all_of(path)) == 1


def test_the_statistics_count_the_messages(path):
    for messages, span in (([], (0, 0)), ([(5, "a", 1, b""), (9, "b", 2, b"")], (5, 9))):
        with new(path, chunk_bytes=1) as writer:
            for message in messages:
                writer.write([message])
            writer.finish("completed")
        with path.open("rb") as file:
            found = make_reader(file).get_summary().statistics
        assert (found.message_start_time, found.message_end_time) == span
        assert (found.message_count, found.chunk_count) == (len(messages), len(messages))
        assert (found.schema_count, found.channel_count) == (1, 3)
        assert found.channel_message_counts == ({2: 1, 1: 1} if messages else {})


def test_a_recording_that_is_closed_leaves_no_thread(path):
    def recording():
        return [thread for thread in threading.enumerate() if thread.name.startswith("recording")]

    before = recording()
    with new(path) as writer:
        writer.write([(5, "a", 1, b"")])
        writer.flush()
        assert len(recording()) == len(before) + 1
        writer.finish("completed")
        assert recording() == before


@pytest.mark.parametrize("verify", [False, True])
def test_a_wrong_digest_is_found_when_verified(path, monkeypatch, verify):
    monkeypatch.setattr("nrs_cosim.recordings.mcap.writer.Digest.hexdigest", lambda _self: "0" * 64)
    with new(path) as writer:
        writer.write([(5, "a", 1, b"")])
        writer.finish("completed")
    monkeypatch.undo()
    with Reader(path, verify=verify) as reader:
        result = [f"the messages had the digest {'0' * 64} when written"]
        assert reader.damage == (result if verify else [])
        assert (reader.digest == "0" * 64) != verify


def test_swapped_chunks_are_out_of_order(path):
    """All else is as written: they are of one size, and their checksums are their own."""
    with new(path, chunk_bytes=1, compression="none") as writer:
        for k in (1, 2, 3):
            writer.write([(k, "a", k, b"same size")])
        writer.finish("completed")
    data = path.read_bytes()
    with path.open("rb") as file:
        one, two, _ = (
            (index.chunk_start_offset, index.chunk_length + index.message_index_length)
            for index in make_reader(file).get_summary().chunk_indexes
        )
    assert one[1] == two[1]
    first, second = (data[at : at + size] for at, size in (one, two))
    path.write_bytes(data[: one[0]] + second + first + data[two[0] + two[1] :])
    with Reader(path, verify=True) as reader:
        assert any("its messages are out of order" in line for line in reader.damage)
        assert [k for _, _, k, _ in reader.messages()] == [2, 3]


@pytest.mark.parametrize(
    ("ticks", "result"),
    [
        ((1, 2, 3), []),
        ((1, 2, 6, 7), ["ticks 3 to 5 are missing"]),
        ((2, 3, 5), ["tick 1 is missing", "tick 4 is missing"]),
    ],
)
def test_missing_ticks_of_a_damaged_recording_are_named(path, ticks, result):
    with new(path, chunk_bytes=1) as writer:
        for k in (0, *ticks):
            writer.write([(k, "a", k, b"")])
        writer.finish("completed")
    path.write_bytes(path.read_bytes()[:-1])
    with Reader(path, verify=True) as reader:
        assert [line for line in reader.damage if line.endswith("missing")] == result
