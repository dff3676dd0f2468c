"""Tables as MAT files, by SciPy's reader of them against the arrays of the recording."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, whosmat

from nrs_cosim.bus.fields import Field, Sizes
from nrs_cosim.bus.messages import Codec, MessageType
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.export import mat
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.export.tables import AGENT_STATES, TableLayout
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import RUN, RunRecord
from tests.recordings import made_up_runs
from tests.recordings.made_up_runs import recorded

LAYOUT = {"k": "uint32", "time_ns": "int64", "t": "double", "robot": "uint32"}
VECTORS = ("position", "velocity", "effort", "reference_position", "reference_velocity")


def test_matlab_reads_the_same_numbers_as_columns_and_matrices(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    recorded(path, n=4, m=3, ticks=20, faulty=(2,), chunk_bytes=2000)
    with Reader(path) as reader:
        written = export(reader, tmp_path / "tables", "mat")
    assert [file.name for file in written] == ["samples.mat", "states.mat", "link_events.mat"]
    with Recording(path) as recording:
        arrays = [recording.samples(), recording.states(), recording.link_events()]
    for file, rows in zip(written, arrays, strict=True):
        variables = loadmat(file, mat_dtype=False)
        found = {name: kind for name, _, kind in whosmat(file)}
        assert [*found] == [*rows.dtype.names, "units", "joints"]
        assert found.items() >= LAYOUT.items()
        for name in rows.dtype.names:
            column = rows[name].reshape(len(rows), -1)
            assert variables[name].dtype == column.dtype
            assert variables[name].tobytes("C") == np.ascontiguousarray(column).tobytes()


def test_a_mat_file_names_the_units_that_are_known(tmp_path: Path) -> None:
    recorded(tmp_path / "run.mcap", n=2, m=2, ticks=3)
    with Reader(tmp_path / "run.mcap") as reader:
        _, states = export(reader, tmp_path, "mat")
    units = loadmat(states, simplify_cells=True)["units"]
    assert units == {
        "time_ns": "ns",
        "t": "s",
        "position": "rad",
        "velocity": "rad/s",
        "effort": "N m",
        "reference_position": "rad",
        "reference_velocity": "rad/s",
    }


def opened(folder: Path, fields: dict[str, Field]):
    of = TableLayout(AGENT_STATES, Codec(MessageType("nrs.Own.AgentState", fields), Sizes(2)))
    said = made_up_runs.about(1, 2, 1)[RUN]
    run = RunRecord.model_validate({**said, "plants": said["plants"].replace('"rad"', '"m"')})
    return of, mat.mat_table(folder / "agent_states.part", of, run)


def test_fields_keep_their_shape_and_declared_unit(tmp_path: Path) -> None:
    of, table = opened(tmp_path, {"P": Field(("m", 3), unit="m^2"), "level": Field(())})
    rows = np.zeros(5, of.dtype)
    rows["P"], rows["level"] = np.arange(30.0).reshape(5, 2, 3), np.arange(5.0)
    with table as put:
        put(rows[:2])
        put(rows[2:])
    found = loadmat(tmp_path / "agent_states.part", appendmat=False)
    assert found["P"].tolist() == rows["P"].tolist()
    assert found["level"].tolist() == [[0.0], [1.0], [2.0], [3.0], [4.0]]
    assert found["units"]["P"][0, 0].item() == "m^2"


def test_a_table_without_rows_has_its_columns(tmp_path: Path) -> None:
    _, table = opened(tmp_path, {"P": Field(("m", 3)), "level": Field(())})
    with table:
        pass
    found = loadmat(tmp_path / "agent_states.part", appendmat=False)
    shapes = {name: found[name].shape for name in ("k", "time_ns", "t", "robot", "level", "P")}
    assert shapes == {
        **dict.fromkeys(("k", "time_ns", "t", "robot", "level"), (0, 1)),
        "P": (0, 2, 3),
    }


@pytest.mark.parametrize(
    ("name", "why"),
    [("units", "the name of the units"), ("x" * 64, "a name of more than 63 characters")],
)
def test_a_name_that_a_mat_file_cannot_have_is_refused(tmp_path: Path, name, why) -> None:
    _, table = opened(tmp_path, {name: Field()})
    with pytest.raises(UncreatableError) as error, table:
        pass
    assert str(error.value) == (
        f"agent_states.mat: {name}: {why}, which a MAT file cannot have; take --format parquet"
    )


def test_a_variable_of_2_gib_is_refused_before_anything_is_written(
    tmp_path: Path, monkeypatch
) -> None:
    recorded(tmp_path / "run.mcap", n=2, m=2, ticks=3)
    monkeypatch.setattr(mat, "MOST_BYTES", 100)
    with (
        Reader(tmp_path / "run.mcap") as reader,
        pytest.raises(UncreatableError, match=r"samples.mat: position: more than 2 GiB"),
    ):
        export(reader, tmp_path / "tables", "mat")
    assert not [*(tmp_path / "tables").iterdir()]
