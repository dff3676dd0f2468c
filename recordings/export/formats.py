"""A recording's tables as CSV or Parquet: every float is the same bits when it is read again.

`samples` has the left limits at t_k, a row a node (robot 0 is the target) and sampling time;
`states` has a row a robot and output time; `link_events`, where the scenario has any, a row a
sample that a link lost, delayed or altered. All are sorted by time, then robot. CSV has floats in
their shortest form that reads back to the same bits. A table gets its name when it is whole.
"""

import csv
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import MissingExtraError
from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.export.tables import (
    LINK_EVENTS,
    SAMPLES,
    STATES,
    MessageTable,
    Put,
    expect_joints,
    joints,
    rows,
)
from nrs_cosim.recordings.mcap.reader import Reader

Format = Literal["csv", "parquet"]
Opener = Callable[[Path, MessageTable, int], AbstractContextManager[Put]]
"""Opens a file for a table of vectors of m numbers; what it gives puts rows into it."""


def export(reader: Reader, folder: Path, form: Format = "csv") -> list[Path]:
    """Write the tables into a folder, made if need be; return their paths.

    Parquet needs the extra `analysis`: `MissingExtraError` without it. `UncreatableError` when the
    folder cannot be written, `UnreadableError` as `rows`; then no table is replaced.
    """
    reader.expect_ticks("export")
    expect_joints(reader)
    opened = _csv if form == "csv" else _parquet()
    faulty = any(channel.schema_name == LINK_EVENTS.kind.name for channel in reader.channels)
    tables = [SAMPLES, STATES, LINK_EVENTS] if faulty else [SAMPLES, STATES]
    m = joints(reader)
    paths = {table.name: folder / f"{table.name}.{form}" for table in tables}
    parts = {name: path.with_suffix(".part") for name, path in paths.items()}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        try:
            with ExitStack() as stack:
                put = {t.name: stack.enter_context(opened(parts[t.name], t, m)) for t in tables}
                for table, found in rows(reader, tables):
                    put[table.name](found)
            return [parts[name].replace(path) for name, path in paths.items()]
        finally:
            for part in parts.values():
                part.unlink(missing_ok=True)
    except OSError as error:
        raise UncreatableError(f"{folder}: cannot be written: {error.strerror}") from None


@contextmanager
def _csv(path: Path, table: MessageTable, m: int) -> Iterator[Put]:
    with path.open("w", newline="", encoding="ascii") as file:
        out = csv.writer(file, lineterminator="\n")
        out.writerow(table.columns(m))

        def put(found: NDArray[np.void]) -> None:
            scalars = zip(*(found[name].tolist() for name in table.scalars), strict=True)
            vectors = np.concatenate([found[name] for name in table.kind.fields], axis=1)
            out.writerows(
                (*head, *row) for head, row in zip(scalars, vectors.tolist(), strict=True)
            )

        yield put


def _parquet() -> Opener:
    try:
        from nrs_cosim.recordings.export.parquet import parquet_table  # noqa: PLC0415 (an extra)
    except ImportError:
        raise MissingExtraError("--format parquet: needs pyarrow", "analysis") from None
    return parquet_table
