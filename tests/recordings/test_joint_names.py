"""What joints are called, and their units, are in each form of a recording's tables."""

import csv
import json

import numpy as np
import pytest
from pyarrow import parquet
from scipy.io import loadmat

from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import RUN
from tests.orchestrator.test_assets import again
from tests.recordings.made_up_runs import recorded

SLIDER = [{"name": "slide é", "unit": "m"}, {"name": "turn", "unit": "rad"}]
ARM = [{"name": "shoulder", "unit": "rad"}, {"name": "elbow", "unit": "rad"}]
UNITS = {"rad": ["rad", "rad/s", "N m"], "m": ["m", "m/s", "N"]}


@pytest.fixture(scope="module", params=[(SLIDER, SLIDER, ARM), (SLIDER, SLIDER, SLIDER)])
def run(request, tmp_path_factory):
    """Return a recording of three robots, and the joints of each: of two kinds, or of one."""
    folder = tmp_path_factory.mktemp("joints")
    recorded(folder / "made.mcap", n=3, m=2, ticks=2)

    def named(records):
        (plant,) = json.loads(records[RUN]["plants"])
        groups = [
            {**plant, "robots": [robot], "joints": joints}
            for robot, joints in enumerate(request.param, 1)
        ]
        return {**records, RUN: {**records[RUN], "plants": json.dumps(groups)}}

    return again(folder / "made.mcap", folder / "run.mcap", records=named), request.param


def names_of(joints):
    return [[joint["name"] for joint in of] for of in joints]


def test_csv_has_a_table_of_the_joints_beside_it(run, tmp_path):
    path, joints = run
    with Reader(path) as reader:
        export(reader, tmp_path)
    with (tmp_path / "joints.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    units = [f"unit_{name}" for name in ("position", "velocity", "effort")]
    assert rows == [
        {
            "robot": str(robot),
            "joint": str(number),
            "name": joint["name"],
            **dict(zip(units, UNITS[joint["unit"]], strict=True)),
        }
        for robot, of in enumerate(joints, 1)
        for number, joint in enumerate(of, 1)
    ]


def test_csv_has_a_table_of_the_columns_beside_it(run, tmp_path):
    """Each unit and joint as Parquet has it in the metadata of the same column."""
    path, _ = run
    with Reader(path) as reader:
        export(reader, tmp_path)
        export(reader, tmp_path, "parquet")
    with (tmp_path / "columns.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    for table in ("samples", "states"):
        of = [row for row in rows if row["table"] == table]
        schema = parquet.read_schema(tmp_path / f"{table}.parquet")
        assert [row["column"] for row in of] == schema.names
        for row in of:
            notes = schema.field(row["column"]).metadata or {}
            for key in ("unit", "joint"):
                assert row[key] == notes.get(key.encode(), b"").decode()


def test_parquet_has_joints_and_units_in_its_metadata(run, tmp_path):
    path, joints = run
    with Reader(path) as reader:
        export(reader, tmp_path, "parquet")
    schema = parquet.read_schema(tmp_path / "states.parquet")
    assert json.loads(schema.metadata[b"nrs.joints"]) == {
        str(robot): of for robot, of in enumerate(joints, 1)
    }
    notes = {
        name: {k.decode(): v.decode() for k, v in (schema.field(name).metadata or {}).items()}
        for name in ("t", "position_1", "velocity_1", "effort_1", "reference_position_2")
    }
    shared = joints[0] == joints[2]
    assert notes == {
        "t": {"unit": "s"},
        "position_1": {"unit": "m", "joint": "slide é"} if shared else {},
        "velocity_1": {"unit": "m/s", "joint": "slide é"} if shared else {},
        "effort_1": {"unit": "N", "joint": "slide é"} if shared else {},
        "reference_position_2": {"unit": "rad", "joint": "turn"} if shared else {},
    }


def test_matlab_and_datasets_have_the_names_of_each_robot(run, tmp_path):
    path, joints = run
    with Reader(path) as reader:
        export(reader, tmp_path, "mat")
    found = loadmat(tmp_path / "states.mat", simplify_cells=True)["joints"]
    assert np.asarray(found).tolist() == names_of(joints)
    with Recording(path) as recording:
        data = recording.dataset()
    assert data.joint_name.to_numpy().tolist() == names_of(joints)
    assert data.joint_unit.sel(robot=1).to_numpy().tolist() == ["m", "rad"]
    assert data.position.sel(robot=2, joint=1).joint_name.item() == "slide é"
