"""A table of flat rows in parts, each a Parquet file that gets its name when it is whole.

Columns have the types that are given by name: `int`, `float` and `str`; each may have None.
"""

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

_KINDS = {"int": pa.int64(), "float": pa.float64(), "str": pa.string()}


def write_part(path: Path, columns: Mapping[str, str], rows: Sequence[Mapping[str, Any]]) -> None:
    """Write rows into a file that is on the disk, whole, before it has its name."""
    schema = pa.schema([(name, _KINDS[of]) for name, of in columns.items()])
    found = [[row.get(name) for row in rows] for name in columns]
    arrays = [pa.array(values, one.type) for values, one in zip(found, schema, strict=True)]
    part = path.with_suffix(".part")
    parquet.write_table(pa.table(arrays, schema=schema), part, compression="zstd")
    with part.open("rb+") as file:
        os.fsync(file.fileno())
    part.replace(path)
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def read_parts(
    paths: Iterable[Path], columns: Mapping[str, str], only: Sequence[str] | None = None
) -> dict[str, list[Any]]:
    """Return columns, all of them or some, over all parts; what an earlier part lacks is None."""
    names = [name for name in columns if only is None or name in only]
    found: dict[str, list[Any]] = {name: [] for name in names}
    for path in paths:
        file = parquet.ParquetFile(path)
        there = {*file.schema_arrow.names}
        table = file.read([name for name in names if name in there])
        for name in names:
            column = table.column(name).to_pylist() if name in there else [None] * table.num_rows
            found[name] += column
    return found
