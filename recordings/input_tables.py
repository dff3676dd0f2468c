"""A table of numbers that others made, by column: CSV with a header, or Parquet."""

import csv
import re
from io import StringIO
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.bus.numerals import decimal
from nrs_cosim.bus.text import not_utf8, quoted, shortened

Columns = dict[str, NDArray[np.float64]]


def file_columns(data: bytes, name: str) -> Columns:
    """Return the columns of a file that is named .csv or .parquet; see `csv_columns`.

    What is missing from a Parquet file's column is NaN there.
    """
    suffix = PurePath(name).suffix.lower()
    if suffix not in {".csv", ".parquet"}:
        raise InputError(f"{name}: expected a file named .csv or .parquet")
    return _parquet(data, name) if suffix == ".parquet" else csv_columns(data, name)


def csv_columns(data: bytes, name: str) -> Columns:
    """Return the columns of CSV by name, each (rows,); an `InputError` begins with a name."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise InputError(f"{name}: cannot be read: {not_utf8(error)}") from None
    lines = csv.reader(StringIO(text, newline=""))
    try:
        names = [column.strip() for column in next(lines, [])]
        cells = ((lines.line_num, row) for row in lines)
        rows = [(line, row) for line, row in cells if row and (len(row) > 1 or row[0].strip())]
    except csv.Error as error:
        raise InputError(f"{name}, line {lines.line_num}: {error}") from None
    if len(names) == 1 and re.search("[;\t]", names[0]):
        raise InputError(
            f"{name}: expected columns separated by commas in its first line, and a point in "
            f"numbers, got {quoted(names[0])}"
        )
    if len(set(names)) < len(names):
        raise InputError(
            f"{name}: expected columns of different names, got {shortened(', '.join(names))}"
        )
    for line, row in rows:
        if len(row) != len(names):
            raise InputError(
                f"{name}, line {line}: expected {len(names)} values, as in the header, "
                f"got {len(row)}"
            )
    found = np.empty((len(rows), len(names)))  # as large as the text is, now that all are there
    for i, (line, row) in enumerate(rows):
        for j, value in enumerate(row):
            try:
                found[i, j] = decimal(value)
            except ValueError:
                raise InputError(
                    f"{name}, line {line}: {shortened(names[j])}: expected a number, got "
                    f"{quoted(value)}"
                ) from None
    return {column: found[:, j] for j, column in enumerate(names)}


def _parquet(data: bytes, name: str) -> Columns:
    try:
        import pyarrow as pa  # noqa: PLC0415 (an extra)
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        need = f"{name}: unlike a .csv file, a .parquet file needs pyarrow"
        raise MissingExtraError(need, "analysis") from None
    try:
        table = parquet.read_table(pa.BufferReader(data))
        return {
            column: table.column(column).cast(pa.float64()).to_numpy().astype(float)
            for column in table.column_names
        }
    except (pa.ArrowException, ValueError) as error:
        raise InputError(f"{name}: no table of numbers: {error}") from None
