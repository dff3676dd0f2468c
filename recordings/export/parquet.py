"""A table as a Parquet file: the columns of the CSV table, counts of 32 bits, ns and floats of 64.

The metadata of a column have its unit, and its joint where all robots call it alike; those of the
file have the joints of each robot, as JSON.

Rows are written in groups of at least `GROUP` bytes, so that neither a long recording fills the
memory nor a small chunk makes a group of its own.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet

from nrs_cosim.recordings.export.tables import Put, TableLayout, flat
from nrs_cosim.recordings.metadata import RunRecord
from nrs_cosim.recordings.units import column_notes, joints_of_each

GROUP = 4 * 2**20
_SCALARS = {"t": pa.float64(), "time_ns": pa.int64()}
"""What is no integer of 32 bits."""


@contextmanager
def parquet_table(path: Path, of: TableLayout, run: RunRecord) -> Iterator[Put]:
    """Open a file for a table; what it gives puts rows into it."""
    kinds = {name: _SCALARS.get(name, pa.uint32()) for name in of.scalars}
    notes = column_notes(of.codec, run)
    fields = [
        pa.field(name, kinds.get(name, pa.float64()), metadata=notes.get(name))
        for name in of.columns
    ]
    joints = {
        str(robot): [joint.model_dump() for joint in all_of]
        for robot, all_of in joints_of_each(run).items()
    }
    schema = pa.schema(fields, {"nrs.joints": json.dumps(joints)})
    waiting: list[NDArray[np.void]] = []
    with parquet.ParquetWriter(path, schema) as file:

        def write() -> None:
            found = np.concatenate(waiting)
            waiting.clear()
            columns = [np.ascontiguousarray(found[name]) for name in of.scalars]
            columns += [
                np.ascontiguousarray(column) for name in of.shapes for column in flat(found[name]).T
            ]
            file.write_table(pa.table(columns, schema=schema))

        def put(found: NDArray[np.void]) -> None:
            waiting.append(found)
            if sum(part.nbytes for part in waiting) >= GROUP:
                write()

        yield put
        if waiting:
            write()
