"""Recordings that were cut, killed, filled the disk or lost bits: what is whole is read."""

import os
import random
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any, get_args

import pytest
from mcap.reader import make_reader
from mcap.writer import Writer as McapWriter

from nrs_cosim.recordings.errors import UnreadableError, UnwritableError
from nrs_cosim.recordings.mcap import chunk, digest
from nrs_cosim.recordings.mcap import writer as writer_module
from nrs_cosim.recordings.mcap.container import Compression, Message
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.recordings.test_container import (
    ATTACHMENTS,
    EACH_TICK,
    METADATA,
    TOPICS,
    H,
    accepted_by_others,
    create,
    in_order,
    naive_digest,
    ticks,
    written,
)

ROOT = Path(__file__).parents[2]


def killed(path: Path, made: Sequence[Sequence[Message]], **options: Any) -> Path:
    """What a writer leaves that dies after its last closed chunk."""
    whole = written(path, made, **options).read_bytes()
    path.write_bytes(whole[: whole.rindex(b"nrs.end", 0, whole.rindex(b"nrs.end")) - 13])
    return path


def is_subsequence(part: Sequence[Message], whole: Sequence[Message]) -> bool:
    rest = iter(whole)
    return all(message in rest for message in part)


def test_an_interrupt_at_any_line_of_write_leaves_whole_ticks(tmp_path: Path) -> None:
    """Ctrl-C is raised at the first, second, ... line that `write` executes, until none is left."""
    made, path, lines = ticks(3), tmp_path / "a.mcap", 0
    watched = {module.__file__ for module in (chunk, digest, writer_module)}
    before = sys.gettrace()
    complete = set()
    while True:
        lines, left = lines + 1, lines + 1

        def interrupt(frame: FrameType, event: str, _: object) -> Any:
            nonlocal left
            if frame.f_code.co_filename not in watched:
                return None
            left -= event == "line"
            if event == "line" and left == 0:
                raise KeyboardInterrupt
            return interrupt

        with create(path, chunk_bytes=800) as writer:
            try:
                sys.settrace(interrupt)
                for tick in made:
                    writer.write(tick)
                sys.settrace(before)
                break
            except KeyboardInterrupt:
                sys.settrace(before)
                writer.finish("interrupted")
        with Reader(path, verify=True) as reader:
            found = [*reader.messages()]
            assert reader.damage == []
            assert found in [in_order(made[:n]) for n in range(4)]
            assert lines % 8 or accepted_by_others(path) == found
            complete.add(reader.ticks)
    assert complete == {0, 1, 2, 3}


def test_a_killed_writer_leaves_its_ticks(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    program = (
        "import sys; from pathlib import Path\n"
        "from tests.recordings.test_container import create, ticks\n"
        "writer = create(Path(sys.argv[1]), chunk_bytes=1)\n"
        "for tick in ticks(7): writer.write(tick)\n"
        "writer.flush()\n"
        "print('written', flush=True); sys.stdin.read()\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(path)],
        cwd=ROOT,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"written\n"
        process.kill()
    with Reader(path) as reader:
        assert [*reader.messages()] == in_order(ticks(7))
        assert (reader.status, reader.ticks, reader.damage) == ("unfinished", 7, [])
        assert reader.digest_here == naive_digest(in_order(ticks(7)))
        assert reader.metadata == METADATA
        assert "killed" in reader.reason


@pytest.mark.parametrize(("room", "status"), [(0, "unfinished"), (4000, "failed")])
def test_a_full_disk_is_named_and_leaves_a_readable_part(
    tmp_path: Path, room: int, status: str
) -> None:
    """Beyond a limit on the file's size the system refuses, after having taken a part."""
    resource = pytest.importorskip("resource")
    made, path = ticks(60), tmp_path / "a.mcap"

    def write(path: Path) -> None:
        with create(path, compression="none", chunk_bytes=8000) as writer:
            for tick in made:
                writer.write(tick)
            writer.finish("completed")

    write(tmp_path / "whole.mcap")
    with (tmp_path / "whole.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary
    begins = summary.chunk_indexes[len(summary.chunk_indexes) // 2].chunk_start_offset
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (begins + room, hard))
    try:
        with pytest.raises(UnwritableError, match=r"a\.mcap: cannot be written: File too large"):
            write(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    with Reader(path) as reader:
        assert reader.ticks > 5
        assert [*reader.messages()] == in_order(made[: reader.ticks])
        assert reader.damage == []
        assert reader.digest_here == naive_digest(in_order(made[: reader.ticks]))
        assert reader.status == status
    if status == "failed":
        assert "File too large" in reader.reason
        assert accepted_by_others(path) == in_order(made[: reader.ticks])


def test_every_prefix_of_a_file_gives_a_prefix_of_the_messages(tmp_path: Path) -> None:
    made = ticks(3)
    path, seen = written(tmp_path / "a.mcap", made, **EACH_TICK), []
    for size in reversed(range(0, path.stat().st_size, cases(1, 3))):
        os.truncate(path, size)
        try:
            reader = Reader(path)
        except UnreadableError:
            seen.append(-1)
            continue
        with reader:
            found = [*reader.messages()]
            assert found == in_order(made[: reader.ticks])
            assert reader.message_count == len(found)
            assert reader.digest_here == naive_digest(found)
            assert reader.status == "unfinished" or reader.ticks == 3
            assert reader.damage or reader.status == "unfinished"
            seen.append(reader.ticks)
    assert seen == sorted(seen, reverse=True)
    assert set(seen) == {3, 2, 1, 0, -1}


ENDED = [(c, e) for c in get_args(Compression) for e in (written, killed)]


@pytest.mark.parametrize(("compression", "ending"), cases(ENDED, [ENDED[0], ENDED[-1]]))
def test_no_flipped_bit_makes_a_wrong_message_or_goes_unnoticed(
    tmp_path: Path, ending: Any, compression: Compression
) -> None:
    made = in_order(ticks(4))
    path = tmp_path / "a.mcap"
    whole = ending(path, ticks(4), compression=compression, **EACH_TICK).read_bytes()
    rng = random.Random(2)
    kept = 0
    for at in rng.sample(range(len(whole)), 600):
        flipped = bytearray(whole)
        flipped[at] ^= 1 << rng.randrange(8)
        path.write_bytes(flipped)
        try:
            reader = Reader(path)
        except UnreadableError:
            continue
        with reader:
            found = [*reader.messages()]
            assert is_subsequence(found, made)
            assert reader.message_count == len(found)
            assert (reader.metadata, reader.attachments) == (METADATA, ATTACHMENTS)
            assert found == made or reader.damage
            assert reader.damage or ending is killed
            assert reader.digest_here == naive_digest(found)
            kept += len(found) > len(made) // 2
    assert kept > 200


def test_a_damaged_chunk_leaves_the_others_readable(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", ticks(4), compression="none", **EACH_TICK)
    made = ticks(4)
    victim = max(data for _, _, _, data in made[1])
    path.write_bytes(path.read_bytes().replace(victim, victim[::-1]))
    with Reader(path) as reader:
        assert [*reader.messages()] == in_order([made[0], *made[2:]])
        assert "its checksum differs" in reader.damage[0]
        gap, missing = reader.damage[1:]
        assert gap == "tick 2 is missing"
        assert missing.startswith("30 of 40 messages are here")
        assert naive_digest(in_order(made)) in missing
        here = naive_digest(in_order([made[0], *made[2:]]))
        assert (reader.status, reader.digest_here) == ("completed", here)
        assert reader.digest is None
        assert reader.ticks == len(
            {k for tick in (made[0], *made[2:]) for _, _, k, _ in tick} - {0}
        )


def test_a_file_that_changes_while_open_is_refused(tmp_path: Path) -> None:
    victim = b"0123456789" * 2000
    path = written(tmp_path / "a.mcap", [[(H, TOPICS[0], 1, victim)]], compression="none")
    with Reader(path) as reader:
        path.write_bytes(path.read_bytes().replace(victim, victim[::-1]))
        with pytest.raises(UnreadableError, match="chunk at byte"):
            [*reader.messages()]


def test_a_file_that_is_no_recording_is_refused_by_name(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    with pytest.raises(UnreadableError, match=r"a\.mcap: cannot be read: No such file"):
        Reader(path)
    with pytest.raises(UnreadableError, match="cannot be read: Is a directory"):
        Reader(tmp_path)
    for content, complaint in ((b"", "is empty"), (b"k,t,robot\n1,0.01,2\n", "no MCAP file")):
        path.write_bytes(content)
        with pytest.raises(UnreadableError, match=rf"a\.mcap: .*{complaint}"):
            Reader(path)
    for profile, complaint in (
        ("ros2", "profile 'ros2', written by 'rosbag2'"),
        ("nrs", "head is cut or damaged"),
    ):
        other = McapWriter(str(path))
        other.start(profile, "rosbag2")
        other.finish()  # type: ignore[no-untyped-call]
        with pytest.raises(UnreadableError, match=complaint):
            Reader(path)
