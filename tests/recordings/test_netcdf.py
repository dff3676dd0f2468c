"""netCDF files by xarray's reader of them, and what of a recording every export can be given."""

import csv
from pathlib import Path

import numpy as np
import pytest
import xarray
from pyarrow import parquet
from scipy.io import loadmat

from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.errors import UncreatableError, UnreadableError
from nrs_cosim.recordings.export.dataset import dataset
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.export.selection import Selected
from nrs_cosim.recordings.mcap.reader import Reader
from tests.command import nrs
from tests.recordings.made_up_runs import recorded

netcdf = pytest.importorskip(
    "nrs_cosim.recordings.export.netcdf", reason="h5netcdf or h5py is not installed"
)
N, M, TICKS = 4, 3, 30
SOME = Selected((2, 4), (1, 3), 550_000_000, 2_100_000_000)


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    recorded(path, n=N, m=M, ticks=TICKS, faulty=(2,), chunk_bytes=3000)
    return path


@pytest.mark.parametrize("selection", [Selected(), SOME, Selected(joints=(2,))])
def test_xarray_reads_a_netcdf_file_as_the_dataset_is(path, tmp_path, selection):
    with Reader(path) as reader:
        netcdf.write_netcdf(reader, tmp_path / "run.nc", selection)
        expected = dataset(reader, selection)
    with xarray.open_dataset(tmp_path / "run.nc", engine="h5netcdf") as found:
        xarray.testing.assert_identical(found.load(), expected)
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.nc"]


def test_a_dataset_of_a_part_is_that_part_of_all(path):
    with Reader(path) as reader:
        part, every = dataset(reader, SOME), dataset(reader)
    times = {name: slice(0.55, 2.0999999) for name in ("time", "sampling_time")}
    xarray.testing.assert_identical(part, every.sel(robot=[2, 4], joint=[1, 3], **times))


def cells(file: Path) -> list[list[str]]:
    with file.open(newline="") as lines:
        return [*csv.reader(lines)]


def test_tables_of_a_part_are_those_rows_and_columns_in_each_format(path, tmp_path):
    with Reader(path) as reader:
        for form in ("csv", "parquet", "mat"):
            export(reader, tmp_path, form, SOME)
    with Recording(path) as recording:
        part = {
            "states": recording.states([2, 4], 0.55, 2.1),
            "samples": recording.samples([0, 2, 4], 0.55, 2.1),
            "link_events": recording.link_events([2, 4], 0.55, 2.1),
        }
    for name, rows in part.items():
        header, *lines = cells(tmp_path / f"{name}.csv")
        fields = [f for f in rows.dtype.names if rows.dtype[f].shape]
        whole = [f for f in rows.dtype.names if f not in fields]
        assert header == [*whole, *(f"{f}_{j}" for f in fields for j in (1, 3))]
        columns = parquet.read_table(tmp_path / f"{name}.parquet")
        assert columns.column_names == header
        matrices = loadmat(tmp_path / f"{name}.mat", chars_as_strings=True)
        for field in fields:
            wanted = rows[field][:, [0, 2]]
            assert (matrices[field] == wanted).all()
            for column, values in zip((f"{field}_1", f"{field}_3"), wanted.T, strict=True):
                assert (columns[column].to_numpy() == values).all()
                at = header.index(column)
                assert [float(line[at]) for line in lines] == values.tolist()
        assert matrices["joints"].shape == (N, 2)
    _, *joints = cells(tmp_path / "joints.csv")
    assert [line[:2] for line in joints] == [["2", "1"], ["2", "3"], ["4", "1"], ["4", "3"]]


def test_a_part_without_messages_leaves_no_file(path, tmp_path):
    nothing = Selected(start_ns=10**12)
    with Reader(path) as reader:
        for write in (
            lambda: netcdf.write_netcdf(reader, tmp_path / "run.nc", nothing),
            lambda: export(reader, tmp_path, "csv", nothing),
        ):
            with pytest.raises(UnreadableError, match="has no messages of these robots and times"):
                write()
        with pytest.raises(UncreatableError, match="cannot be written"):
            netcdf.write_netcdf(reader, tmp_path / "none" / "run.nc")
    assert not [*tmp_path.iterdir()]


def test_the_command_names_an_option_that_is_wrong(path, tmp_path):
    for options, said in (
        (["--joints", "4"], "error: --joints: got '4' in '4', but there are joints 1 to 3"),
        (["--joints", "1,joint_2,j"], "error: --joints: no joint is called 'j'; there are joint_1"),
        (["--robots", "0"], "error: --robots: expected robots like 1-3,7, got '0': robots count"),
        (["--to", "ssp", "--robots", "1"], "error: --robots: a system is of the whole run"),
        (["--to", "nc", "-o", tmp_path / "a.csv"], "is the name of a table"),
    ):
        done = nrs("export", path, "-o", tmp_path / "out", *options)
        assert (done.returncode, said in done.stderr) == (2, True), done.stderr
    done = nrs(  # what -o ends in is its format
        "export", path, "-o", tmp_path / "out.nc", "--robots", "1,3", "--until", "1"
    )
    assert done.returncode == 0, done.stderr
    with xarray.open_dataset(tmp_path / "out.nc", engine="h5netcdf") as found:
        assert found.robot.to_numpy().tolist() == [1, 3]
        assert found.time.to_numpy().max() < 1
        assert np.isfinite(found.position).all()
