"""A table as a MAT file of version 5, which MATLAB, GNU Octave and SciPy open without a toolbox.

An array has a variable of its name, a row a message: whole numbers as they are, fields (rows, …).
The struct `units` has those that are known, by variable; the cell array
`joints` has the joints' names, a row a robot. A variable of version 5 is written at
once and below 2 GiB, so the rows of a table are held in memory; what the version cannot have is
refused.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.io import savemat

from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.export.tables import Put, TableLayout
from nrs_cosim.recordings.metadata import RunRecord
from nrs_cosim.recordings.units import coordinate_of, field_unit, joints_of_each

UNITS, JOINTS = "units", "joints"
LONGEST_NAME = 63
"""What MATLAB's `namelengthmax` is."""
MOST_BYTES = 2**31 - 1
"""Of a variable."""


@contextmanager
def mat_table(path: Path, of: TableLayout, run: RunRecord) -> Iterator[Put]:
    """Open a file for a table of a run; what it gives puts rows into it.

    `UncreatableError` for a name or a size that a MAT file of version 5 cannot have.
    """
    for name in of.shapes:
        if name in {UNITS, JOINTS}:
            raise _refused(of, name, f"the name of the {name}")
        if len(name) > LONGEST_NAME:
            raise _refused(of, name, f"a name of more than {LONGEST_NAME} characters")
    known = of.codec.kind.fields if of.codec else {}
    units = {"time_ns": "ns", "t": "s"}
    units |= {name: field_unit(name, field, coordinate_of(run)) for name, field in known.items()}
    waiting: list[NDArray[np.void]] = [np.empty(0, of.dtype)]
    size = 0

    def put(found: NDArray[np.void]) -> None:
        nonlocal size
        size += len(found)
        for name in found.dtype.names or ():
            if size * found.dtype[name].itemsize > MOST_BYTES:
                raise _refused(of, name, "more than 2 GiB")
        waiting.append(found)

    yield put
    rows = np.concatenate(waiting)
    arrays = {name: rows[name] for name in of.dtype.names or ()}
    columns = {name: x if x.ndim > 1 else x[:, np.newaxis] for name, x in arrays.items()}
    known_units = {name: unit for name, unit in units.items() if unit}
    joints = [
        [all_of[number - 1].name for number in of.joints or range(1, len(all_of) + 1)]
        for all_of in joints_of_each(run).values()
    ]
    about = {UNITS: known_units, JOINTS: np.array(joints, object)}
    with path.open("wb") as file:
        savemat(file, {**columns, **about}, long_field_names=True)


def _refused(of: TableLayout, name: str, why: str) -> UncreatableError:
    return UncreatableError(
        f"{of.table.name}.mat: {name}: {why}, which a MAT file cannot have; take --format parquet"
    )
