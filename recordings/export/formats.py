"""A recording's tables as CSV, Parquet or MAT: every float is the same bits when it is read again.

`samples` has the left limits at t_k, a row a node (robot 0 is the target) and sampling time;
`states` has a row a robot and output time; `agent_states`, where agents keep more than an estimate,
a row a robot and sampling time; `measurements`, where their algorithm measures the target in a way
of its own, a row a pinned robot and sampling time; `link_events`, where the scenario has any, a row
a sample that a link lost, delayed, duplicated or altered. A number of an array has a column of its
own. All are sorted by time, then robot. Beside CSV, `columns` has a row a column of each table with
its unit, and `joints` a row a joint of each robot with name and units, as the other formats hold
themselves. CSV has floats in the fewest digits that read back to the same bits. A table gets its
name when it is whole.
"""

import csv
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic_core import to_json

from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.bus.messages import STATE
from nrs_cosim.recordings.errors import UncreatableError, UnreadableError
from nrs_cosim.recordings.export.selection import ALL, NOTHING, Selected
from nrs_cosim.recordings.export.tables import (
    MESSAGES,
    Put,
    TableLayout,
    flat,
    layout,
    recorded_tables,
    rows,
)
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import RunRecord
from nrs_cosim.recordings.schemas import about, expect_joints, recorded_types
from nrs_cosim.recordings.units import column_notes, field_unit, joints_of_each

Format = Literal["csv", "parquet", "mat"]
Opener = Callable[[Path, TableLayout], AbstractContextManager[Put]]
"""Opens a file for a table; what it gives puts rows into it."""
_COLUMNS, _JOINTS = "columns", "joints"
"""What stands beside tables as CSV."""


def export(
    reader: Reader, folder: Path, form: Format = "csv", selection: Selected = ALL
) -> list[Path]:
    """Write the tables of a selection into a folder, made if need be; return their paths.

    Tables of another recording that this one has not are removed there, in the same format: the
    folder is of one recording.
    Parquet needs the extra `analysis`: `MissingExtraError` without it. `UncreatableError` when the
    folder cannot be written, `UnreadableError` as `rows`; then no table is replaced.
    """
    reader.expect_ticks("export")
    types = recorded_types(reader)
    expect_joints(reader, types)
    opened = _opener(form, reader)
    layouts = {
        table.name: layout(types, table, selection.joints) for table in recorded_tables(types)
    }
    tables = [of.table for of in layouts.values()]
    paths = {table.name: folder / f"{table.name}.{form}" for table in tables}
    if form == "csv":
        paths |= {name: folder / f"{name}.csv" for name in (_COLUMNS, _JOINTS)}
    parts = {name: path.with_suffix(".part") for name, path in paths.items()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with ExitStack() as stack:
                put: dict[str, Put] = {}

                def open_table(name: str) -> Put:
                    return stack.enter_context(opened(parts[name], layouts[name]))

                # Once there is a row: before, nothing says that there are as many columns.
                between = selection.start_ns, selection.end_ns
                for table, found in rows(reader, tables, selection.nodes, *between):
                    if table.name not in put:
                        put[table.name] = open_table(table.name)
                    put[table.name](layouts[table.name].narrowed(found))
                if not put:
                    raise UnreadableError(f"{reader.path}: {NOTHING}")
                for name, of in layouts.items():
                    if name not in put:
                        of.expect_few_columns(reader.path)
                        open_table(name)
            if form == "csv":
                run = about(reader).run
                _write_columns(parts[_COLUMNS], layouts.values(), run)
                _write_joints(parts[_JOINTS], run, selection)
            written = [parts[name].replace(path) for name, path in paths.items()]
            for path in older_tables(folder, form, written):
                path.unlink()
            return written
        finally:
            for part in parts.values():
                part.unlink(missing_ok=True)
    except OSError as error:
        raise UncreatableError(f"{folder}: cannot be written: {error.strerror}") from None


def older_tables(folder: Path, form: Format, but: Collection[Path] = ()) -> list[Path]:
    """Return the tables of a format that are in a folder, but some."""
    paths = (folder / f"{name}.{form}" for name in MESSAGES)
    return [path for path in paths if path not in but and path.is_file()]


def _opener(form: Format, reader: Reader) -> Opener:
    match form:
        case "csv":
            return _csv
        case "parquet":
            return _parquet(about(reader).run)
        case "mat":
            from nrs_cosim.recordings.export.mat import mat_table  # noqa: PLC0415, it loads scipy.io

            return partial(mat_table, run=about(reader).run)


@contextmanager
def _csv(path: Path, of: TableLayout) -> Iterator[Put]:
    with path.open("wb") as file:
        file.write(f"{','.join(of.columns)}\n".encode("ascii"))

        def put(found: NDArray[np.void]) -> None:
            cells = [found[name].tolist() for name in of.scalars]
            cells += [column.tolist() for name in of.shapes for column in flat(found[name]).T]
            # JSON has each number as CSV does, and is written in a fifth of the time.
            lists = to_json([*zip(*cells, strict=True)])
            file.write(lists[2:-2].replace(b"],[", b"\n") + b"\n")

        yield put


def _parquet(run: RunRecord) -> Opener:
    try:
        from nrs_cosim.recordings.export.parquet import parquet_table  # noqa: PLC0415 (an extra)
    except ImportError:
        raise MissingExtraError("--format parquet: needs pyarrow", "analysis") from None
    return partial(parquet_table, run=run)


def _write_columns(path: Path, layouts: Iterable[TableLayout], run: RunRecord) -> None:
    """Write of each column its unit, and its joint where all robots call it alike."""
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["table", "column", "unit", "joint"])
        for of in layouts:
            notes = column_notes(of.codec, run)
            for column in of.columns:
                note = notes.get(column, {})
                out.writerow([of.table.name, column, note.get("unit"), note.get("joint")])


def _write_joints(path: Path, run: RunRecord, selection: Selected) -> None:
    """Write what a CSV table has no place for: names and units of each robot's joints."""
    robots, chosen = selection.robots, selection.joints
    quantities = {name: STATE.fields[name] for name in ("position", "velocity", "effort")}
    with path.open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(["robot", "joint", "name", *(f"unit_{name}" for name in quantities)])
        for robot, joints in joints_of_each(run).items():
            for number, joint in enumerate(joints, 1):
                if robot not in (robots or [robot]) or number not in (chosen or [number]):
                    continue
                units = (field_unit(name, of, joint.unit) for name, of in quantities.items())
                out.writerow([robot, number, joint.name, *units])
