"""Whatever a recording still holds is made whole again, and what it lacks is said."""

from pathlib import Path

import pytest

from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.mcap.copy import RECOVERED, recover
from nrs_cosim.recordings.mcap.reader import Reader
from tests.recordings.made_up_runs import create, recorded, tick

EACH_TICK = {"chunk_bytes": 1, "compression": "none"}


def recovered(path: Path) -> Reader:
    with Reader(path) as reader:
        recover(reader, path.with_name("new.mcap"))
    return Reader(path.with_name("new.mcap"), verify=True)


def test_a_lost_chunk_leaves_a_named_gap(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    made = recorded(path, ticks=20, faulty=[2], **EACH_TICK)
    data = path.read_bytes()
    for k in (5, 6, 7, 12):
        victim = next(m[3] for m in made if m[2] == k)
        data = data.replace(victim, victim[::-1])
    path.write_bytes(data)
    with Reader(path) as reader, recovered(path) as new:
        assert [line for line in reader.damage if "missing" in line] == [
            "ticks 5 to 7 are missing",
            "tick 12 is missing",
        ]
        assert reader.ticks == new.ticks == 16
        left = [message for message in made if message[2] not in {5, 6, 7, 12}]
        assert [*new.messages()] == [*reader.messages()] == left
        assert (new.digest_here, new.message_count) == (reader.digest_here, len(left))
        assert new.digest is None
        assert (new.status, new.damage) == ("failed", [])
        assert new.reason.startswith(f"recovered from {path.name}: completed; chunk at byte ")
        assert "ticks 5 to 7 are missing" in new.reason
        assert new.metadata[RECOVERED]["status"] == "completed"
        assert "tick 12 is missing" in new.metadata[RECOVERED]["damage"]
        assert new.attachments == reader.attachments
        assert {**new.metadata, RECOVERED: {}} == {**reader.metadata, RECOVERED: {}}
        assert new.channels == reader.channels


def test_a_killed_run_is_recovered_as_unfinished(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with create(path, 3, 2, 9, (), **EACH_TICK) as writer:
        for k in range(5):
            writer.write(tick(k, 3, 2))
        writer.flush()
        copy = tmp_path / "killed.mcap"
        copy.write_bytes(path.read_bytes())
    with recovered(copy) as new:
        assert (new.status, new.ticks) == ("failed", 4)
        assert "unfinished; never closed" in new.reason
        assert new.metadata[RECOVERED]["status"] == "unfinished"


def test_a_recording_without_its_index_keeps_its_ending(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    made = recorded(path, ticks=5)
    data = path.read_bytes()
    path.write_bytes(data[:-100])
    with Reader(path) as reader, recovered(path) as new:
        assert reader.damage
        assert (new.status, new.reason, new.ticks) == ("completed", "", 5)
        assert [*new.messages()] == made
        assert new.damage == []


def test_missing_last_ticks_are_named(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    made = recorded(path, ticks=6, **EACH_TICK)
    data = path.read_bytes()
    for k in (5, 6):
        victim = next(m[3] for m in made if m[2] == k)
        data = data.replace(victim, victim[::-1])
    path.write_bytes(data)
    with Reader(path) as reader:
        assert "ticks 5 to 6 are missing" in reader.damage


def test_recover_overwrites_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorded(path, ticks=2)
    before = path.read_bytes()
    with Reader(path) as reader, pytest.raises(UncreatableError, match="is there already"):
        recover(reader, path)
    assert path.read_bytes() == before
