"""A recording as arrays, tables and files, against its messages taken one by one."""

import csv
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path

import numpy as np
import pyarrow.parquet
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import LINK_EVENT, SAMPLE, STATE, Codec
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.export.tables import LINK_EVENTS, SAMPLES, STATES
from nrs_cosim.recordings.mcap.columns import columns
from nrs_cosim.recordings.mcap.container import DamageError, Message
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from tests.recordings.made_up_runs import about, chain, create, recorded, tick
from tests.scenarios import toml
from tests.topics import node_of

N, M, TICKS, FAULTY = 11, 3, 40, (2, 10)
KINDS = {"sample": SAMPLE, "state": STATE, "link_event": LINK_EVENT}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Message]]:
    """A run of 11 robots in many chunks, whose faults fall in some of them."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    return path, recorded(path, n=N, m=M, ticks=TICKS, faulty=FAULTY, chunk_bytes=9000)


def expected(messages: list[Message], kind: str, robots: set[int], start: int, end: int) -> list:
    """Rows of (k, t, robot, everything else), by one message after the other."""
    codec, rows = Codec(KINDS[kind], Sizes(M)), []
    for time_ns, topic, k, data in messages:
        node = node_of(topic)
        if kind_of(topic) == kind and node in robots and start <= time_ns < end:
            (record,) = codec.decode([data])
            names = (*codec.kind.counts, *codec.kind.fields)
            rows.append((time_ns, node, k, [record[name].tolist() for name in names]))
    return sorted(rows)


@pytest.mark.parametrize("robots", [None, {3, 10}, {0}, set()])
@pytest.mark.parametrize(
    "within", [(None, None), (0.55, 2.3), (3.95, None), (None, 0.0), (9, None)]
)
def test_arrays_agree_with_the_messages(run, robots, within) -> None:
    path, messages = run
    start, end = (None if t is None else round(t * 1e9) for t in within)
    bounds = (start or 0, 2**63 if end is None else end)
    with Recording(path) as recording:
        for kind, read in (
            ("sample", recording.samples),
            ("state", recording.states),
            ("link_event", recording.link_events),
        ):
            if robots == {0} and kind != "sample":
                with pytest.raises(InputError, match="robots: expected 1 to 11, got 0"):
                    read(robots, *within)
                continue
            found = read(robots, *within)
            names = (*KINDS[kind].counts, *KINDS[kind].fields)
            rows = [
                (*row[["time_ns", "robot", "k"]].tolist(), [row[name].tolist() for name in names])
                for row in found
            ]
            wanted = set(range(N + 1)) if robots is None else robots
            assert rows == expected(messages, kind, wanted, *bounds)
            assert (found["t"] == found["time_ns"] / 1e9).all()
            assert found[next(iter(KINDS[kind].fields))].shape == (len(found), M)


def test_only_the_chunks_of_a_range_are_read(run, monkeypatch: pytest.MonkeyPatch) -> None:
    with Recording(run[0]) as recording:
        chunks = len(list(recording.chunks([STATES])))
        read: list[int] = []
        seen = Reader._columns
        monkeypatch.setattr(
            Reader, "_columns", lambda self, span: read.append(span.offset) or seen(self, span)
        )
        assert len(recording.states(start=1.0, end=1.05)) == N
        assert (chunks, len(read)) == (chunks, 1)
        assert chunks > 10
        recording.samples(robots=[])
        recording.samples(start=5.0)
        assert len(read) == 1


def test_a_recording_describes_its_run(run) -> None:
    with Recording(run[0]) as recording, Reader(run[0]) as reader:
        assert recording.scenario == toml(base=chain(N, M, TICKS))
        assert recording.metadata == about(N, M, TICKS)
        assert (recording.status, recording.reason, recording.damage) == ("completed", "", [])
        assert (recording.digest, recording.ticks) == (reader.digest, TICKS)
        assert (recording.robots, recording.joints) == (N, M)


def test_a_recording_of_no_run_is_refused(tmp_path: Path) -> None:
    with Writer(
        tmp_path / "a.mcap", version="1", channels=[], schemas=[], metadata={}, attachments={}
    ) as writer:
        writer.finish("completed")
    with pytest.raises(UnreadableError, match=r"a\.mcap: holds no run"):
        Recording(tmp_path / "a.mcap")


def test_a_message_of_a_wrong_type_is_refused(tmp_path: Path) -> None:
    (good, *_) = tick(1, 2, 2)
    nan = good[3][:-8] + np.float64("nan").tobytes()
    for data, complaint in ((good[3][:-1], "another size"), (nan, "not finite")):
        with create(tmp_path / "a.mcap", 2, 2, 1, ()) as writer:
            writer.write([(*good[:3], data)])
            writer.finish("completed")
        with (
            Recording(tmp_path / "a.mcap") as recording,
            pytest.raises(UnreadableError, match=complaint),
        ):
            recording.states()


def test_a_wrongly_guessed_layout_changes_no_value(run) -> None:
    """Each chunk is taken apart with the layout of each other one, and of none."""
    with Reader(run[0]) as reader:
        found = list(reader.columns())
        for chunk in found[:6]:
            for other in (*found, None):
                again = columns(chunk.data, reader.topics, None if other is None else other.start)
                assert (again.start == chunk.start).all()
                assert again.messages(reader.topics) == chunk.messages(reader.topics)
            for wrong in (chunk.data[:-1], chunk.data + b"\x05", chunk.data[1:], b"\x05" * 40):
                with pytest.raises(DamageError):
                    columns(wrong, reader.topics, chunk.start)


def test_a_dataset_has_recorded_values_and_nan_elsewhere(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    silent = {(3, "/robot_2/sample"), (4, "/robot_2/sample"), (4, "/robot_1/state")}
    made = [
        [message for message in tick(k, 2, 2) if (k, message[1]) not in silent] for k in range(6)
    ]
    with create(path, 2, 2, 5, ()) as writer:
        for messages in made:
            writer.write(messages)
        writer.finish("completed")
    with Recording(path) as recording:
        data = recording.dataset()
        for name, table in (("position", recording.states()), ("effort", recording.states())):
            for row in table:
                at = data[name].sel(time=row["t"], robot=row["robot"])
                assert (at.to_numpy() == row[name]).all()
        for row in recording.samples():
            if row["robot"]:
                at = data.sample_velocity.sel(sampling_time=row["t"], robot=row["robot"])
            else:
                at = data.target_velocity.sel(sampling_time=row["t"])
            assert (at.to_numpy() == row["velocity"]).all()
    assert dict(data.sizes) == {"time": 11, "sampling_time": 5, "robot": 2, "joint": 2}
    assert data.position.dims == ("time", "robot", "joint")
    assert int(data.position.isnull().sum()) == 2 * 2
    assert int(data.sample_position.isnull().sum()) == 2 * 2
    assert not data.target_position.isnull().any()
    assert np.isnan(data.sample_position.sel(sampling_time=0.3, robot=2)).all()
    assert {data[name].attrs["units"] for name in data.data_vars} == {"rad", "rad/s", "N m"}
    assert data.time.attrs["units"] == "s"
    assert data.attrs["status"] == "completed"


def rows_of(path: Path) -> Iterator[list[str]]:
    with path.open(newline="") as file:
        yield from csv.reader(file)


def test_csv_and_parquet_hold_the_same_bits(run, tmp_path: Path) -> None:
    with Recording(run[0]) as recording, Reader(run[0]) as reader:
        arrays = {
            SAMPLES: recording.samples(),
            STATES: recording.states(),
            LINK_EVENTS: recording.link_events(),
        }
        names = [f"{table.name}.csv" for table in arrays]
        assert [path.name for path in export(reader, tmp_path)] == [
            *names,
            "columns.csv",
            "joints.csv",
        ]
        export(reader, tmp_path, "parquet")
    assert len(list(tmp_path.iterdir())) == 8
    for table, array in arrays.items():
        header, *rows = rows_of(tmp_path / f"{table.name}.csv")
        parquet = pyarrow.parquet.read_table(tmp_path / f"{table.name}.parquet")
        assert parquet.column_names == header
        kind = KINDS[table.kind]
        scalars = ["k", "time_ns", "t", "robot", *kind.counts]
        assert header[: len(scalars)] == scalars
        for i, name in enumerate(header):
            vector, _, joint = name.rpartition("_")
            column = array[vector][:, int(joint) - 1] if vector in kind.fields else array[name]
            floats = column.dtype == float
            assert [Decimal(row[i]) for row in rows] == [
                Decimal(repr(float(x)) if floats else int(x)) for x in column
            ]
            assert parquet[name].to_numpy().tobytes() == np.ascontiguousarray(column).tobytes()


def test_a_run_without_faults_has_no_link_event_table(tmp_path: Path) -> None:
    """Nor one of an earlier export, which would be taken for its own."""
    recorded(tmp_path / "a.mcap", ticks=2)
    others = {"link_events.parquet", "notes.csv"}
    for name in ("link_events.csv", *others):
        (tmp_path / "mix").mkdir(exist_ok=True)
        (tmp_path / "mix" / name).touch()
    with Reader(tmp_path / "a.mcap") as reader:
        names = [path.name for path in export(reader, tmp_path / "mix")]
    assert names == ["samples.csv", "states.csv", "columns.csv", "joints.csv"]
    assert {path.name for path in (tmp_path / "mix").iterdir()} == {*names, *others}


def test_a_recording_has_a_repr_and_selects_robots_by_number(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorded(path, n=3, m=2, ticks=4)
    with Recording(path) as recording:
        assert repr(recording) == (
            f"<Recording {str(path)!r}: completed, 3 robots with 2 joints, 4 ticks>"
        )
        assert (recording.states(robots=3) == recording.states(robots=[3])).all()
        times = recording.states(start=0.1, end=0.3)["t"]
        assert (times.min(), times.max()) == (0.1, 0.25)
        assert len(recording.states(start=float("-inf"), end=float("inf"))) == 3 * 9
        with pytest.raises(InputError, match=r"robots: expected 0, the target, to 3, got 9"):
            recording.samples(robots=[9])
        with pytest.raises(InputError, match=r"start: expected a time in s, got nan"):
            recording.states(start=float("nan"))
        assert len(recording.samples(robots=0)) == 4
