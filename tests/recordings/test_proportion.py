"""What a file makes us take of memory is in proportion to what stands in it.

Each file is read by a process of its own, whose peak is held against that of reading a sound one.
"""

import subprocess
import sys
import zlib
from pathlib import Path
from unittest.mock import patch

import lz4.frame
import numpy as np
import pytest
import zstandard
from mcap import records as mcap
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.stream_reader import StreamReader

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes
from nrs_cosim.bus.keys import topic_of
from nrs_cosim.bus.messages import HEADER
from nrs_cosim.recordings.channels import channels, schemas
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.input_tables import csv_columns
from nrs_cosim.recordings.mcap import writer as writer_module
from nrs_cosim.recordings.mcap.chunk import decoded_chunk
from nrs_cosim.recordings.mcap.columns import HEAD, columns
from nrs_cosim.recordings.mcap.container import (
    DamageError,
    encoded,
    in_proportion,
    tail,
)
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from nrs_cosim.recordings.metadata import RUN
from nrs_cosim.recordings.schemas import fields_record
from tests.recordings.made_up_runs import about, chain, create, recorded, tick
from tests.scenarios import toml

ROOT = Path(__file__).parents[2]
MIB = 2**20
N, M, TICKS = 2, 2, 3
COMPRESS = {"zstd": zstandard.compress, "lz4": lz4.frame.compress, "": bytes}
READ = """
import sys
from pathlib import Path
from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, measure
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.export import dataset
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.mcap.reader import Reader
path = Path(sys.argv[1])

def info():
    with Reader(path) as reader:
        describe(reader, experiment_of(reader)), measure(reader, experiment_of(reader))

def tables():
    with Reader(path) as reader:
        export(reader, path.with_suffix(""))

def arrays():
    with Recording(path) as recording:
        recording.states(), recording.dataset()

for read in (info, tables, arrays):
    try:
        read()
    except InputError as error:
        print(error)
status = Path("/proc/self/status").read_text()
print(next(line.split()[1] for line in status.splitlines() if line.startswith("VmHWM")))
"""

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="reads the peak from /proc")


def peak(path: Path) -> float:
    """MiB that a process had at most that read a recording in several ways."""
    command = [sys.executable, "-c", READ, path]
    done = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True)
    return int(done.stdout.splitlines()[-1]) / 1024


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[bytes], float]:
    """A recording of a chunk a tick; its bytes up to the second chunk, and from it on; its peak."""
    path = tmp_path_factory.mktemp("sound") / "run.mcap"
    recorded(path, n=N, m=M, ticks=TICKS, chunk_bytes=1)
    whole = path.read_bytes()
    with Reader(path) as reader:
        second = reader._chunks[1].offset
    return path, [whole[:second], whole[second:]], peak(path)


def chunk(compression: str, records: bytes) -> bytes:
    """A chunk with right sizes and checksum."""
    data = COMPRESS[compression](records)
    return encoded(mcap.Chunk(compression, data, 0, 0, zlib.crc32(records), len(records)))


def message(size: int) -> bytes:
    """A record of a message of so many zeros."""
    one = np.zeros(1, HEAD)
    one["kind"], one["length"], one["channel"] = Opcode.MESSAGE, HEAD.itemsize - 9 + size, 1
    return one.tobytes() + bytes(size)


@pytest.mark.parametrize("records", [bytes(256 * MIB), message(MIB) * 256], ids=["zeros", "real"])
def test_a_chunk_of_absurd_size_is_damage_and_the_rest_is_read(sound, tmp_path, records):
    path, (before, after), least = sound
    bomb = tmp_path / "bomb.mcap"
    bomb.write_bytes(before + chunk("zstd", records) + after)
    assert bomb.stat().st_size < 40_000
    with Reader(path) as was, Reader(bomb) as now:
        assert list(now.messages()) == list(was.messages())
        (damage, _) = now.damage
        assert damage.startswith(f"chunk at byte {len(before)}: it is refused, for its ")
        assert f"decompress to {len(records)};" in damage
    assert peak(bomb) < least + 30


def test_many_chunks_of_garbage_take_the_memory_of_one(sound, tmp_path):
    _, (before, after), least = sound
    bomb = tmp_path / "bomb.mcap"
    bomb.write_bytes(before + chunk("zstd", bytes(8 * MIB)) * 50 + after)
    assert peak(bomb) < least + 40


@pytest.mark.parametrize("compression", COMPRESS)
def test_a_highly_compressed_chunk_of_usual_size_is_read(compression):
    records = message(MIB - HEAD.itemsize) * 4
    assert decoded_chunk(chunk(compression, records)) == records
    assert len(columns(records, [1]).time) == 4


def test_the_proportion_rule_begins_where_lz4_ends():
    records = bytes(64 * MIB)
    assert decoded_chunk(chunk("lz4", records)) == records
    with pytest.raises(DamageError, match="is refused, for its"):
        decoded_chunk(chunk("zstd", records))
    assert in_proportion(8 * MIB, 1)
    assert not in_proportion(8 * MIB + 1, 1)
    assert in_proportion(256 * 2**20, 2**20)
    assert not in_proportion(256 * 2**20 + 1, 2**20)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_tick_that_compresses_too_well_is_stored_readably(tmp_path, compression):
    path = tmp_path / "rest.mcap"
    said = sorted(
        (0, topic_of("sample", node), 0, HEADER.pack(node, 0, 0) + bytes(16 * MIB))
        for node in range(2)
    )
    with create(path, N, M, TICKS, (), compression=compression) as writer:
        writer.write(said)
        writer.finish("failed")
    with Reader(path, verify=True) as reader:
        assert reader.damage == []
        assert list(reader.messages()) == said
    with path.open("rb") as file:
        read = [
            (m.log_time, c.topic, m.sequence, m.data)
            for _, c, m in make_reader(file).iter_messages()
        ]
        assert read == said
        file.seek(0)
        names = [
            r.compression
            for r in StreamReader(file, emit_chunks=True).records
            if isinstance(r, mcap.Chunk)
        ]
    assert names == [{"none": ""}.get(compression, "lz4")]


def sealed(path: Path, m: int = M, spans: int = 1, **said: int) -> Path:
    """Write a run with right seals and checksums that says of itself what it is asked to."""
    used = channels(Codecs.of(Sizes(M)), N, (), False)
    attachments = {"scenario.toml": ("application/toml", toml(base=chain(N, M, TICKS)).encode())}
    metadata = about(N, M, TICKS)
    metadata[RUN]["joints"] = str(m)

    def other(*, fields, chunk_indexes, **rest):
        fields = fields | {name: str(value) for name, value in said.items()}
        return tail(fields=fields, chunk_indexes=[*chunk_indexes] * spans, **rest)

    with (
        patch.object(writer_module, "tail", other),
        Writer(
            path,
            version="1.2",
            channels=used,
            schemas=schemas(used, Codecs.of(Sizes(M))),
            metadata=metadata,
            attachments=attachments,
        ) as writer,
    ):
        for k in range(TICKS + 1):
            writer.write(tick(k, N, M))
        writer.finish("completed")
    return path


def test_joints_without_messages_take_no_memory(sound, tmp_path):
    path = sealed(tmp_path / "joints.mcap", m=2**20)
    assert peak(path) < sound[2] + 30


def test_fields_without_messages_take_no_memory(sound, tmp_path):
    """40 fields of 8 MiB each, of every node and time, in a small file of small messages."""
    many = {f"x{number}q": Field((2**20,)) for number in range(40)}
    claimed = Codecs.of(Sizes(M), "Mine", many, {**ESTIMATE, **many})
    codecs = Codecs.of(Sizes(M))
    used = channels(claimed, N, (), False)
    with Writer(
        tmp_path / "a.mcap",
        version="1.2",
        channels=used,
        schemas=schemas(used, claimed),
        metadata={**about(N, M, TICKS), **fields_record(claimed)},
        attachments={"scenario.toml": ("application/toml", toml(base=chain(N, M, TICKS)).encode())},
    ) as writer:
        for k in range(TICKS + 1):
            writer.write(tick(k, N, M, (), codecs))
        writer.finish("completed")
    assert (tmp_path / "a.mcap").stat().st_size < 30_000
    assert peak(tmp_path / "a.mcap") < sound[2] + 30


def test_a_chunk_listed_repeatedly_is_read_once(sound, tmp_path):
    path = sealed(tmp_path / "again.mcap", spans=100)
    with Reader(path) as reader, Reader(sound[0]) as was:
        assert list(reader.messages()) == list(was.messages())
        assert reader.damage == [
            "a checksum differs or is missing, yet every message is as written"
        ]


@pytest.mark.parametrize("said", [{"messages": 10**6}, {"ticks": 10**6}], ids=str)
def test_counts_beyond_the_files_size_are_refused(tmp_path, said):
    with pytest.raises(UnreadableError, match=r"nrs\.end: messages: is .* room for"):
        Reader(sealed(tmp_path / "many.mcap", **said))


def test_missing_columns_are_refused_before_memory_is_allocated():
    names = ",".join(f"c{i}" for i in range(10**6))
    data = (names + "\n" + "1\n" * 10**5).encode()
    with pytest.raises(InputError, match="line 2: expected 1000000 values"):
        csv_columns(data, "target.csv")
