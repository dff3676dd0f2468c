"""The container against mcap's own readers, a naive digest, and all that can happen to a file."""

import hashlib
import random
from collections.abc import Sequence
from pathlib import Path
from typing import Any, get_args

import pytest
from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap.records import Chunk, MessageIndex
from mcap.records import Message as McapMessage
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from nrs_cosim.recordings.errors import UncreatableError, UnwritableError
from nrs_cosim.recordings.mcap.container import Channel, Compression, Message, Schema
from nrs_cosim.recordings.mcap.digest import Digest
from nrs_cosim.recordings.mcap.ordering import columns_of
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer

H = 10_000_000  # ns
TOPICS = ("nrs/0/sample", "nrs/1/sample", "nrs/1/state", "nrs/2/sample", "nrs/2/state", "nrs/é")
COUNTED = tuple(Channel(topic, "t.Point") for topic in TOPICS)
CHANNELS = (*COUNTED, Channel("faults", "t.Point", counted=False))
METADATA: dict[str, dict[str, str]] = {"scenario": {"text": "h = 0.01 # é"}, "empty": {}}
ATTACHMENTS = {"s.toml": ("application/toml", b"[network]\n"), "none": ("text/plain", b"")}
# t.Point { repeated double x = 1; }
POINT = FileDescriptorProto(name="t.proto", package="t", syntax="proto3")
POINT.message_type.add(name="Point").field.add(
    name="x",
    number=1,
    type=FieldDescriptorProto.TYPE_DOUBLE,
    label=FieldDescriptorProto.LABEL_REPEATED,
)
SCHEMA = Schema("t.Point", FileDescriptorSet(file=[POINT]).SerializeToString())
EACH_TICK = {"chunk_bytes": 1}
NEVER = {"chunk_bytes": 2**30, "chunk_seconds": float("inf")}


def ticks(n: int) -> list[list[Message]]:
    """Ticks 1 ... n, each shuffled: counted topics, states at two times, two faults at one time."""
    rng = random.Random(1)
    made = []
    for k in range(1, n + 1):
        tick = [(k * H, topic, k, rng.randbytes(rng.randrange(40))) for topic in TOPICS]
        tick += [(k * H - H // 2, topic, k, b"") for topic in TOPICS if topic.endswith("state")]
        tick += [(k * H, "faults", k, bytes([which])) for which in (2, 1)]
        rng.shuffle(tick)
        made.append(tick)
    return made


def in_order(made: Sequence[Sequence[Message]]) -> list[Message]:
    return [message for tick in made for message in sorted(tick)]


def naive_digest(messages: Sequence[Message]) -> str:
    """The law of the digest, written down once more."""
    sha = hashlib.sha256()
    for time, topic, sequence, data in messages:
        if topic != "faults":
            name = topic.encode()
            sha.update(len(name).to_bytes(4, "little") + name)
            sha.update(time.to_bytes(8, "little") + sequence.to_bytes(4, "little"))
            sha.update(len(data).to_bytes(4, "little") + data)
    return sha.hexdigest()


def create(path: Path, **options: Any) -> Writer:
    about = {"channels": CHANNELS, "metadata": METADATA, "attachments": ATTACHMENTS}
    return Writer(path, version="1.2", schemas=[SCHEMA], **(about | options))


def written(path: Path, made: Sequence[Sequence[Message]], **options: Any) -> Path:
    with create(path, **options) as writer:
        for tick in made:
            writer.write(tick)
        writer.finish("completed", "all ticks done", {"wall": "1 s"})
    return path


def accepted_by_others(path: Path) -> list[Message]:
    """The messages by each of mcap's readers with all its checks, which must agree."""
    found: list[list[Message]] = []
    with path.open("rb") as file:
        seeking = make_reader(file, validate_crcs=True)
        assert isinstance(seeking, SeekingReader)
        summary = seeking.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        found.append(
            [(m.log_time, c.topic, m.sequence, m.data) for _, c, m in seeking.iter_messages()]
        )
        statistics = summary.statistics
        assert statistics.message_count == len(found[0])
        assert statistics.chunk_count == len(summary.chunk_indexes)
        assert {
            summary.channels[n].topic: m for n, m in statistics.channel_message_counts.items()
        } == {
            topic: sum(t == topic for _, t, _, _ in found[0])
            for topic in {t for _, t, _, _ in found[0]}
        }
        assert (statistics.schema_count, statistics.channel_count) == (1, len(CHANNELS))
        assert statistics.attachment_count == len(ATTACHMENTS) == len([*seeking.iter_attachments()])
        metadata = {record.name: record.metadata for record in seeking.iter_metadata()}
        assert statistics.metadata_count == len(metadata)
        assert METADATA.items() <= metadata.items()
        if found[0]:
            assert statistics.message_start_time == found[0][0][0]
            assert statistics.message_end_time == found[0][-1][0]
    with path.open("rb") as file:
        others = NonSeekingReader(file, validate_crcs=True).iter_messages(log_time_order=False)
        found.append([(m.log_time, c.topic, m.sequence, m.data) for _, c, m in others])
    with path.open("rb") as file:
        records = [*StreamReader(file, validate_crcs=True).records]
        assert sum(isinstance(record, McapMessage) for record in records) == len(found[0])
    assert found[0] == found[1]
    return found[0]


@pytest.mark.parametrize("compression", get_args(Compression))
@pytest.mark.parametrize("chunks", [EACH_TICK, {"chunk_bytes": 1000}, NEVER])
def test_recordings_are_read_by_all_readers(
    tmp_path: Path, compression: Compression, chunks: dict[str, Any]
) -> None:
    made = ticks(20)
    path = written(tmp_path / "a.mcap", made, compression=compression, **chunks)
    assert accepted_by_others(path) == in_order(made)
    for verify in (False, True):
        with Reader(path, verify=verify) as reader:
            assert [*reader.messages()] == in_order(made)
            assert (reader.status, reader.reason) == ("completed", "all ticks done")
            assert (reader.ticks, reader.message_count) == (20, len(in_order(made)))
            assert (reader.start_ns, reader.end_ns) == (H // 2, 20 * H)
            assert reader.digest == naive_digest(in_order(made))
            assert reader.library == "nrs-cosim 1.2"
            assert (reader.channels, reader.schemas) == (CHANNELS, (SCHEMA,))
            assert (reader.metadata, reader.attachments) == (METADATA, ATTACHMENTS)
            assert reader.end["wall"] == "1 s"
            assert reader.damage == []


def test_message_indexes_point_at_their_messages(tmp_path: Path) -> None:
    """Viewers seek by them: each offset, in the decompressed chunk, is that of such a message."""
    path = written(tmp_path / "a.mcap", ticks(9), compression="none", chunk_bytes=1000)
    pointed = 0
    with path.open("rb") as file:
        for record in StreamReader(file, emit_chunks=True).records:
            if isinstance(record, Chunk):
                data = record.data
            elif isinstance(record, MessageIndex):
                for time, at in record.records:
                    assert data[at] == 5
                    assert int.from_bytes(data[at + 9 : at + 11], "little") == record.channel_id
                    assert int.from_bytes(data[at + 15 : at + 23], "little") == time
                    pointed += 1
    assert pointed == len(in_order(ticks(9)))


def test_protobuf_is_decoded_unaided(tmp_path: Path) -> None:
    point = bytes([0x0A, 16]) + bytes.fromhex("000000000000f03f00000000000000c0")  # 1.0, -2.0
    path = written(tmp_path / "a.mcap", [[(H, TOPICS[0], 1, point)]])
    with path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert [[*m.decoded_message.x] for m in reader.iter_decoded_messages()] == [[1.0, -2.0]]


def test_ranges_are_half_open_and_topics_are_chosen(tmp_path: Path) -> None:
    made = in_order(ticks(12))
    path = written(tmp_path / "a.mcap", ticks(12), chunk_bytes=1000)
    with Reader(path) as reader:
        for start, end in ((3 * H, 7 * H), (None, H), (12 * H, None), (4 * H, 4 * H), (H, 2**63)):
            for topics in (None, {TOPICS[2]}, [TOPICS[0], "faults"], ["unknown"]):
                assert [*reader.messages(topics, start, end)] == [
                    message
                    for message in made
                    if (start or 0) <= message[0] < (2**64 if end is None else end)
                    and (topics is None or message[1] in topics)
                ]
        assert [m for batch in reader.batches() for m in batch] == made
        assert len([*reader.batches()]) > 3


def test_the_digest_separates_its_parts() -> None:
    """What moves between topic, data or messages changes it; how updates are cut does not."""
    one = [(1, "a", 1, b"bc"), (2, "a", 1, b"")]
    digests, topics = {naive_digest(one)}, {1: "a", 2: "ab"}
    numbers = {"a": 1, "ab": 2, "not counted": 3}
    for other in ([(1, "ab", 1, b"c"), one[1]], [one[0]], [(1, "a", 1, b"b"), (2, "a", 1, b"c")]):
        running = Digest(topics)
        running.update(columns_of(other, numbers))
        digests.add(running.hexdigest())
    assert len(digests) == 4
    running = Digest({1: "a"})
    running.update(columns_of(one[:1], numbers))
    twin = running.copy()
    running.update(columns_of([(2, "not counted", 1, b"x"), *one[1:]], numbers))
    assert running.hexdigest() == naive_digest(one)
    assert twin.hexdigest() == naive_digest(one[:1])


def test_a_run_without_messages_is_a_valid_recording(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", [[]])
    assert accepted_by_others(path) == []
    with Reader(path, verify=True) as reader:
        assert (reader.ticks, reader.message_count, reader.damage) == (0, 0, [])
        assert (reader.start_ns, reader.end_ns) == (None, None)
        assert reader.digest == hashlib.sha256().hexdigest()


@pytest.mark.parametrize(
    ("error", "status", "reason"),
    [
        (RuntimeError("robot 3 is silent"), "failed", "RuntimeError: robot 3 is silent"),
        (KeyboardInterrupt(), "interrupted", "KeyboardInterrupt"),
        (OSError("lost \udcff"), "failed", "OSError: lost \\udcff"),
        (None, "failed", "closed before the run ended"),
    ],
)
def test_leaving_the_block_closes_the_file(
    tmp_path: Path, error: BaseException | None, status: str, reason: str
) -> None:
    made = ticks(3)

    def run() -> None:
        with create(tmp_path / "a.mcap", **NEVER) as writer:
            for tick in made:
                writer.write(tick)
            if error is not None:
                raise error

    if error is None:
        run()
    else:
        with pytest.raises(type(error)):
            run()
    assert accepted_by_others(tmp_path / "a.mcap") == in_order(made)
    with Reader(tmp_path / "a.mcap") as reader:
        assert (reader.status, reader.reason, reader.ticks) == (status, reason, 3)
        assert reader.digest == naive_digest(in_order(made))


def test_ticks_in_the_past_are_refused_as_a_whole(tmp_path: Path) -> None:
    made = ticks(3)
    far = [(9 * H, TOPICS[0], 9, b""), (2 * H, TOPICS[0], 9, b"")]
    with create(tmp_path / "a.mcap") as writer:
        for tick in made:
            writer.write(tick)
        for wrong in (made[2], made[0], far, [(3 * H, TOPICS[-1], 4, b"")]):
            with pytest.raises(ValueError, match="not after"):
                writer.write(wrong)
        with pytest.raises(ValueError, match="'nowhere' has no channel"):
            writer.write([(4 * H, TOPICS[0], 4, b""), (4 * H, "nowhere", 4, b"")])
        for time, sequence in ((-1, 4), (2**64, 4), (4 * H, 2**32), (4 * H, -1)):
            with pytest.raises(ValueError, match="out of range"):
                writer.write([(time, TOPICS[0], sequence, b"")])
        writer.finish("completed")
    assert accepted_by_others(tmp_path / "a.mcap") == in_order(made)


def test_writing_after_the_end_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path / "a.mcap", ticks(1))
    before = path.read_bytes()
    with create(path, **NEVER) as writer:
        writer.write(ticks(1)[0])
        with pytest.raises(ValueError, match="'done'"):
            writer.finish("done")  # type: ignore[arg-type]
        with pytest.raises(ValueError, match="'ticks'"):
            writer.finish("completed", "", {"ticks": "7"})
        writer.finish("completed", "all ticks done", {"wall": "1 s"})
        with pytest.raises(UnwritableError, match=r"a\.mcap: is closed"):
            writer.write(ticks(2)[1])
        with pytest.raises(UnwritableError, match=r"a\.mcap: is closed"):
            writer.finish("failed")
    assert path.read_bytes() == before


def test_the_head_is_refused_when_it_contradicts_itself(tmp_path: Path) -> None:
    for options, complaint in (
        ({"channels": [*CHANNELS, CHANNELS[0]]}, "two channels"),
        ({"channels": [Channel("a", "t.Line")]}, r"t\.Line"),
        ({"metadata": {"nrs.end": {}}}, r"nrs\.end"),
    ):
        with pytest.raises(ValueError, match=complaint):
            create(tmp_path / "a.mcap", **options)
    assert not (tmp_path / "a.mcap").exists()
    with pytest.raises(UncreatableError, match=r"b\.mcap: cannot be created: No such file"):
        create(tmp_path / "no" / "b.mcap")
