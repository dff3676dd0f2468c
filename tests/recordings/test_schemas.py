"""A recording of any declared messages is read by its own schemas; odd ones are refused by name."""

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from nrs_cosim.api.recording import Recording as Api
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import LINK_EVENT, SAMPLE, STATE, MessageType
from nrs_cosim.bus.schemas import SchemaError, message_type
from nrs_cosim.recordings import LINK_EVENTS, Recording
from nrs_cosim.recordings.channels import channels
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.mcap.container import Message, Schema
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from nrs_cosim.recordings.schemas import FIELDS, fields_record
from tests.recordings.made_up_runs import about, chain, create, recorded, tick
from tests.scenarios import toml
from tests.topics import node_of

N, M, TICKS, FAULTY = 4, 2, 7, (2, 3)
SIZES = Sizes(M, N, 3)
SENT = {
    "position": Field(truth="position", doc="estimate of where the target is"),
    "P": Field((2, "m", "m"), unit="rad^2", doc="covariance"),
    "level": Field(()),
}
KEPT = {**ESTIMATE, "last": Field(("in_degree", "m")), "votes": Field(("n",)), "next": Field(())}
CODECS = Codecs.of(SIZES, "Filter", SENT, KEPT, measured=True, duplicates=True)


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Message]]:
    path = tmp_path_factory.mktemp("declared") / "run.mcap"
    made = recorded(path, n=N, m=M, ticks=TICKS, faulty=FAULTY, codecs=CODECS, chunk_bytes=9000)
    return path, made


def by_protobuf(path: Path, messages: list[Message]) -> dict[tuple[str, int, int], dict[str, Any]]:
    """Return what protobuf reads by the schemas in a file: by kind, time and node, flat lists."""
    with Reader(path) as reader:
        data = {schema.name: schema.data for schema in reader.schemas}
        kinds = {channel.topic: channel.schema_name for channel in reader.channels}
    classes = {}
    for name, descriptor in data.items():
        pool = descriptor_pool.DescriptorPool()
        for file in descriptor_pb2.FileDescriptorSet.FromString(descriptor).file:
            pool.Add(file)
        classes[name] = message_factory.GetMessageClass(pool.FindMessageTypeByName(name))
    found = {}
    for time_ns, topic, _, payload in messages:
        read = classes[kinds[topic]].FromString(payload)
        values = {of.name: value for of, value in read.ListFields()}
        found[kind_of(topic), time_ns, node_of(topic)] = {
            name: list(value) if hasattr(value, "__len__") else value
            for name, value in values.items()
        }
    return found


def test_arrays_agree_with_protobuf_in_the_declared_shapes(run) -> None:
    path, messages = run
    read = by_protobuf(path, messages)
    with Recording(path) as recording:
        tables = {
            "sample": (recording.samples(), {"position": (M,), "P": (2, M, M), "level": ()}),
            "agent_state": (
                recording.agent_states(),
                {"last": (3, M), "votes": (N,), "next": ()},
            ),
            "measurement": (
                recording.measurements(),
                {"position": (M,), "P": (2, M, M), "level": ()},
            ),
            "state": (recording.states(), dict.fromkeys(STATE.fields, (M,))),
            "link_event": (
                recording.link_events(),
                {"duplicates": (), "position": (M,), "P": (2, M, M), "level": ()},
            ),
        }
    assert sum(len(rows) for rows, _ in tables.values()) == len(messages) == len(read)
    for kind, (rows, shapes) in tables.items():
        for name, shape in shapes.items():
            assert rows[name].shape[1:] == shape
        for row in rows:
            theirs = read[kind, int(row["time_ns"]), int(row["robot"])]
            for name in shapes:
                assert np.ravel(row[name]).tolist() == np.ravel(theirs[name]).tolist()


def test_every_number_has_its_own_column_with_the_same_bits_in_csv_and_parquet(
    run, tmp_path: Path
) -> None:
    path, _ = run
    with Reader(path) as reader:
        written = export(reader, tmp_path)
        export(reader, tmp_path, "parquet")
    names = ["samples", "states", "agent_states", "measurements", "link_events"]
    assert [file.name for file in written] == [
        f"{name}.csv" for name in (*names, "columns", "joints")
    ]
    with (tmp_path / "samples.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == [
        *("k", "time_ns", "t", "robot", "position_1", "position_2"),
        *(f"P_{i}_{j}_{k}" for i in (1, 2) for j in (1, 2) for k in (1, 2)),
        "level",
    ]
    with Recording(path) as recording:
        samples, kept = recording.samples(), recording.agent_states()
    assert [float(row[header.index("P_2_1_2")]) for row in rows] == samples["P"][
        :, 1, 0, 1
    ].tolist()
    assert [float(row[-1]) for row in rows] == samples["level"].tolist()
    table = pyarrow.parquet.read_table(tmp_path / "agent_states.parquet")
    assert table.column_names[4:] == [
        *("last_1_1", "last_1_2", "last_2_1", "last_2_2", "last_3_1", "last_3_2"),
        *("votes_1", "votes_2", "votes_3", "votes_4", "next"),
    ]
    assert table["last_3_1"].to_numpy().tolist() == kept["last"][:, 2, 0].tolist()
    with Api(path) as recording:
        assert len(recording.to_pandas("measurements")) == 2 * TICKS
        frame = recording.to_pandas("agent_states")
        assert list(frame.columns) == table.column_names
        assert frame["votes_4"].tolist() == kept["votes"][:, 3].tolist()
        with pytest.raises(InputError, match="table: expected states or samples"):
            recording.to_pandas("agents")  # type: ignore[arg-type]


def test_a_dataset_has_the_dimensions_of_the_declared_shapes(run) -> None:
    with Recording(run[0]) as recording:
        data, samples, kept = recording.dataset(), recording.samples(), recording.agent_states()
    dims = {name: data[name].dims[1:] for name in data.data_vars}
    assert dims["sample_position"] == ("robot", "joint")
    assert dims["sample_P"] == ("robot", "sample_P_axis_1", "joint", "sample_P_axis_3")
    assert dims["sample_level"] == ("robot",)
    assert dims["target_P"] == ("target_P_axis_1", "joint", "target_P_axis_3")
    assert dims["agent_last"] == ("robot", "in_neighbour", "joint")
    assert dims["agent_votes"] == ("robot", "other_robot")
    assert dims["agent_next"] == ("robot",)
    assert dims["measured_P"] == ("robot", "measured_P_axis_1", "joint", "measured_P_axis_3")
    assert np.isnan(data.measured_level).any("sampling_time").to_numpy().tolist() == [0, 1, 0, 1]
    assert dict(data.sizes)["other_robot"] == N
    for row in samples[samples["robot"] > 0]:
        at = data.sel(sampling_time=row["t"], robot=row["robot"])
        assert (at.sample_P.to_numpy() == row["P"]).all()
        assert float(at.sample_level) == row["level"]
    for row in kept:
        at = data.sel(sampling_time=row["t"], robot=row["robot"])
        assert (at.agent_last.to_numpy() == row["last"]).all()
    assert data.sample_P.attrs == {"long_name": "covariance", "units": "rad^2"}
    assert data.sample_position.attrs["units"] == "rad"
    assert "units" not in data.sample_level.attrs


def test_shapes_and_units_of_declared_fields_are_recorded(run) -> None:
    with Reader(run[0]) as reader:
        said = reader.metadata[FIELDS]
        units = {channel.topic: channel.metadata for channel in reader.channels}
    assert json.loads(said["nrs.Filter.Sample.P"]) == {
        "shape": [2, "m", "m"],
        "truth": None,
        "unit": "rad^2",
        "doc": "covariance",
    }
    assert json.loads(said["nrs.Filter.Sample.position"])["truth"] == "position"
    assert said["in_degree"] == "3"
    assert not any(key.startswith("nrs.State") for key in said)
    assert units["/robot_1/sample"] == {}


def test_standard_types_need_no_extra_field_records() -> None:
    assert fields_record(Codecs.of(Sizes(2, 5, 3))) == {}
    assert fields_record(Codecs.of(Sizes(2, 5, 3), duplicates=True)) == {}


def test_a_run_without_agent_states_has_no_rows_of_them(tmp_path: Path) -> None:
    recorded(tmp_path / "a.mcap", ticks=2)
    with Recording(tmp_path / "a.mcap") as recording:
        assert recording.agent_states().dtype.names == ("k", "time_ns", "t", "robot")
        assert len(recording.agent_states()) == 0


def test_a_dataset_is_whole_where_samples_and_agent_states_have_other_times(tmp_path: Path) -> None:
    gone = {(2, "sample"), (3, "agent_state")}
    made = [
        [
            message
            for message in tick(k, 2, 2, (), CODECS_OF_TWO)
            if (k, kind_of(message[1])) not in gone
        ]
        for k in range(4)
    ]
    with create(tmp_path / "a.mcap", 2, 2, 3, (), CODECS_OF_TWO) as writer:
        for messages in made:
            writer.write(messages)
        writer.finish("completed")
    with Recording(tmp_path / "a.mcap") as recording:
        data = recording.dataset()
    np.testing.assert_allclose(data.sampling_time, [0.1, 0.2, 0.3])
    assert np.isnan(data.sample_level.sel(sampling_time=0.2)).all()
    assert np.isnan(data.agent_next.sel(sampling_time=0.3)).all()
    assert not np.isnan(data.agent_next.sel(sampling_time=0.2)).any()


CODECS_OF_TWO = Codecs.of(Sizes(2, 2, 3), "Filter", SENT, KEPT)


@pytest.mark.parametrize("kind", [SAMPLE, STATE, LINK_EVENT], ids=lambda kind: kind.name)
def test_a_type_is_read_from_its_schema_as_it_was_declared(kind) -> None:
    read = message_type(kind.name, kind.descriptor(), {})
    assert list(read.entries) == list(kind.entries)
    for name, entry in read.entries.items():
        assert entry.doc == kind.entries[name].doc
    assert {name: field.shape for name, field in read.fields.items()} == {
        name: field.shape for name, field in kind.fields.items()
    }
    assert read.descriptor() == kind.descriptor()


def test_a_type_has_at_most_a_thousand_fields() -> None:
    for number in (997, 998):
        many = MessageType("nrs.Many", {f"x{place}q": Field(()) for place in range(number)})
        if number == 997:
            assert len(message_type("nrs.Many", many.descriptor(), {}).fields) == number
        else:
            with pytest.raises(SchemaError, match="has 1001 fields, over 1000"):
                message_type("nrs.Many", many.descriptor(), {})


def described(kind, change) -> bytes:
    """Return a type's schema after a change to its only message."""
    files = descriptor_pb2.FileDescriptorSet.FromString(kind.descriptor())
    change(files.file[0].message_type[0])
    return files.SerializeToString()


def of(field_name: str, **values: Any):
    """Return a change of one field."""

    def change(message) -> None:
        (field,) = (field for field in message.field if field.name == field_name)
        for key, value in values.items():
            setattr(field, key, value)

    return change


def unpacked(message) -> None:
    message.field[3].options.packed = False


def without_presence(message) -> None:
    for field in message.field:
        field.ClearField("proto3_optional")


def with_a_wide_number(message) -> None:
    kind = descriptor_pb2.FieldDescriptorProto.TYPE_FIXED64
    message.field.add(name="wide", number=6, type=kind, label=1, proto3_optional=True)


INT64 = descriptor_pb2.FieldDescriptorProto.TYPE_INT64
WRONG = {
    "no descriptor": ("nrs.Sample", b"\xff\xff", "'nrs.Sample': is no protobuf FileDescriptorSet"),
    "another type": ("nrs.Sample", STATE.descriptor(), "is not described in its schema"),
    "a type that no run writes": (
        "nrs.Sample",
        described(SAMPLE, of("velocity", type=INT64)),
        "field 'velocity': no run writes such",
    ),
    "a further number of 64 bits": (
        "nrs.Sample",
        described(SAMPLE, with_a_wide_number),
        "'nrs.Sample': has a further number of 64 bits",
    ),
    "a gap in the numbers": (
        "nrs.Sample",
        described(SAMPLE, of("velocity", number=7)),
        "field 'velocity': no run writes such",
    ),
    "one name twice": (
        "nrs.Sample",
        described(SAMPLE, of("velocity", name="position")),
        "field 'position': no run writes such",
    ),
    "a name that is none": (
        "nrs.Sample",
        described(SAMPLE, of("velocity", name="a b")),
        "field 'a b': expected a name",
    ),
    "an array that is not packed": ("nrs.Sample", described(SAMPLE, unpacked), "field 'position'"),
    "no presence": ("nrs.Sample", described(SAMPLE, without_presence), "field 'robot': no run"),
    "another opening": (
        "nrs.Sample",
        described(SAMPLE, of("k", name="tick")),
        "field k: missing, or not as every message's",
    ),
    "a state without efforts": (
        "nrs.State",
        described(STATE, of("effort", name="torque")),
        "'nrs.State': is of states, but has no effort",
    ),
    "a link event that begins with another count": (
        "nrs.LinkEvent",
        described(LINK_EVENT, of("source", name="origin")),
        "has no source in the first place",
    ),
    "a link event without delay": (
        "nrs.LinkEvent",
        described(LINK_EVENT, of("delay", name="late")),
        "has no delay",
    ),
}


@pytest.mark.parametrize(("name", "schema", "words"), WRONG.values(), ids=WRONG)
def test_a_schema_that_no_run_writes_is_refused_by_name(tmp_path, name, schema, words) -> None:
    codecs = Codecs.of(Sizes(M))
    used = channels(codecs, 2, (1,), False)
    data = {kind.name: kind.descriptor() for kind in codecs.types} | {name: schema}
    with Writer(
        tmp_path / "a.mcap",
        version="1",
        channels=used,
        schemas=[Schema(*one) for one in data.items()],
        metadata=about(2, M, 2),
        attachments={"scenario.toml": ("application/toml", toml(base=chain(2, M, 2)).encode())},
    ) as writer:
        for k in range(3):
            writer.write(tick(k, 2, M))
        writer.finish("completed")
    with Recording(tmp_path / "a.mcap") as recording:
        for read in (recording.samples, recording.states, recording.link_events):
            with pytest.raises(UnreadableError) as raised:
                read()
            assert words in str(raised.value)
            assert "use another copy" in str(raised.value)


RECORDS = {
    "no JSON": ({"nrs.Filter.Sample.P": "{"}, "nrs.fields: nrs.Filter.Sample.P: Invalid JSON"),
    "no shape": ({"nrs.Filter.Sample.P": "{}"}, "nrs.fields: nrs.Filter.Sample.P.shape"),
    "an axis of nothing": (
        {"nrs.Filter.Sample.P": '{"shape": [0]}'},
        "nrs.fields: nrs.Filter.Sample.P.shape.0",
    ),
    "an unknown symbol": (
        {"nrs.Filter.Sample.P": '{"shape": ["q"]}'},
        "nrs.fields: nrs.Filter.Sample.P.shape.0",
    ),
    "too many axes": (
        {"nrs.Filter.Sample.P": '{"shape": [1, 1, 1, 1, 1]}'},
        "P: shape: expected at most 4 axes",
    ),
    "more numbers than fit": (
        {"nrs.Filter.Sample.P": '{"shape": ["in_degree", "in_degree"]}', "in_degree": "5000"},
        "schema nrs.Filter.Sample: P: would have 25000000 numbers",
    ),
    "a scalar that is an array": (
        {"nrs.Filter.Sample.P": '{"shape": []}'},
        "field 'P': no run writes such",
    ),
    "an array that is a scalar": (
        {"nrs.Filter.Sample.level": '{"shape": [2]}'},
        "field 'level': no run writes such",
    ),
    "another size": ({"nrs.Filter.Sample.P": '{"shape": [3]}'}, "a message has another size"),
    "no number": ({"in_degree": "many"}, "nrs.fields: in_degree: Input should be"),
}


@pytest.mark.parametrize(("record", "words"), RECORDS.values(), ids=RECORDS)
def test_a_contradictory_field_record_is_refused_by_name(tmp_path, record, words) -> None:
    said = {FIELDS: {**fields_record(CODECS_OF_TWO)[FIELDS], **record}}
    codecs = CODECS_OF_TWO
    used = channels(codecs, 2, (1,), False)
    with Writer(
        tmp_path / "a.mcap",
        version="1",
        channels=used,
        schemas=[Schema(kind.name, kind.descriptor()) for kind in codecs.types],
        metadata={**about(2, M, 2), **said},
        attachments={"scenario.toml": ("application/toml", toml(base=chain(2, M, 2)).encode())},
    ) as writer:
        for k in range(3):
            writer.write(tick(k, 2, M, (), codecs))
        writer.finish("completed")
    with Recording(tmp_path / "a.mcap") as recording, pytest.raises(UnreadableError) as raised:
        recording.samples()
    assert words in str(raised.value)


def test_one_kind_of_messages_has_one_schema(tmp_path: Path) -> None:
    codecs = Codecs.of(Sizes(M))
    used = channels(codecs, 2, (), False)
    other = [
        type(c)(c.topic, "nrs.State", c.counted) if c.topic == "/robot_2/sample" else c
        for c in used
    ]
    with Writer(
        tmp_path / "a.mcap",
        version="1",
        channels=other,
        schemas=[Schema(kind.name, kind.descriptor()) for kind in codecs.types],
        metadata=about(2, M, 2),
        attachments={"scenario.toml": ("application/toml", toml(base=chain(2, M, 2)).encode())},
    ) as writer:
        writer.write(tick(0, 2, M))
        writer.finish("completed")
    with (
        Recording(tmp_path / "a.mcap") as recording,
        pytest.raises(UnreadableError, match="topics of kind sample have 2 schemas, expected one"),
    ):
        list(recording.chunks([LINK_EVENTS]))
