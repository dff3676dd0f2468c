"""A recording is read while it grows: each message once, as soon as its chunk is whole."""

from contextlib import ExitStack, suppress

import pytest

from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.growing import GrowingReader
from tests.recordings.made_up_runs import recorded


@pytest.mark.parametrize("pieces", [1, 7, 200])
def test_pieces_of_any_size_give_each_message_once(tmp_path, pieces):
    whole, growing = tmp_path / "whole.mcap", tmp_path / "growing.mcap"
    messages = recorded(whole, n=2, ticks=30, chunk_bytes=2000)
    data, found = whole.read_bytes(), []
    step = -(-len(data) // pieces)
    with ExitStack() as stack:
        reader, file = None, stack.enter_context(growing.open("wb", buffering=0))
        for at in range(0, len(data), step):
            file.write(data[at : at + step])
            with suppress(UnreadableError):  # the head is not whole yet
                reader = reader or stack.enter_context(GrowingReader(growing))
            for columns in reader.grown() if reader else ():
                found += columns.messages(reader.topics)
            assert found == messages[: len(found)]
        assert found == messages
        assert reader.is_whole


def test_a_chunk_that_is_not_as_written_is_waited_for(tmp_path):
    path = tmp_path / "a.mcap"
    messages = recorded(path, n=2, ticks=30, chunk_bytes=2000)
    whole = path.read_bytes()
    at = whole.index(b"zstd", whole.index(b"nrs.begin")) + 20
    path.write_bytes(whole[:at] + b"?" * 9 + whole[at + 9 :])
    with GrowingReader(path) as reader:
        assert list(reader.grown()) == []
        path.write_bytes(whole)
        found = [m for columns in reader.grown() for m in columns.messages(reader.topics)]
    assert found == messages
