"""A table of numbers that others made, by column: CSV with a header, or Parquet."""

import csv
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError, MissingExtraError
from nrs_cosim.bus.numerals import decimal
from nrs_cosim.bus.text import quoted, shortened

Columns = dict[str, NDArray[np.float64]]


def read_columns(path: Path) -> Columns:
    """Return the columns of a .csv or .parquet file by name, each (rows,); `InputError` if bad.

    What is missing from a Parquet file's column is NaN there.
    """
    if path.suffix.lower() not in {".csv", ".parquet"}:
        raise InputError(f"{path}: expected a file named .csv or .parquet")
    try:
        return _parquet(path) if path.suffix.lower() == ".parquet" else _csv(path)
    except FileNotFoundError:
        raise InputError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: cannot be read: it is no text in UTF-8") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from None


def _csv(path: Path) -> Columns:
    with path.open(newline="", encoding="utf-8-sig") as file:
        lines = csv.reader(file)
        try:
            names = [name.strip() for name in next(lines, [])]
            cells = ((lines.line_num, row) for row in lines)
            rows = [(line, row) for line, row in cells if row and (len(row) > 1 or row[0].strip())]
        except csv.Error as error:
            raise InputError(f"{path}, line {lines.line_num}: {error}") from None
    if len(names) == 1 and re.search("[;\t]", names[0]):
        raise InputError(
            f"{path}: expected columns separated by commas in its first line, and a point in "
            f"numbers, got {quoted(names[0])}"
        )
    if len(set(names)) < len(names):
        raise InputError(
            f"{path}: expected columns of different names, got {shortened(', '.join(names))}"
        )
    for line, row in rows:
        if len(row) != len(names):
            raise InputError(
                f"{path}, line {line}: expected {len(names)} values, as in the header, "
                f"got {len(row)}"
            )
    found = np.empty((len(rows), len(names)))  # as large as the text is, now that all are there
    for i, (line, row) in enumerate(rows):
        for j, value in enumerate(row):
            try:
                found[i, j] = decimal(value)
            except ValueError:
                raise InputError(
                    f"{path}, line {line}: {shortened(names[j])}: expected a number, got "
                    f"{quoted(value)}"
                ) from None
    return {name: found[:, j] for j, name in enumerate(names)}


def _parquet(path: Path) -> Columns:
    try:
        import pyarrow as pa  # noqa: PLC0415 (an extra)
        from pyarrow import parquet  # noqa: PLC0415
    except ImportError:
        need = f"{path}: unlike a .csv file, a .parquet file needs pyarrow"
        raise MissingExtraError(need, "analysis") from None
    try:
        table = parquet.read_table(path)
        return {
            name: table.column(name).cast(pa.float64()).to_numpy().astype(float)
            for name in table.column_names
        }
    except (pa.ArrowException, ValueError) as error:
        raise InputError(f"{path}: no table of numbers: {error}") from None
