"""A recording as a netCDF-4 file, which is HDF5 too: the variables of `grids`, a chunk at a time.

MATLAB, Julia, R and Python read it with units and long names. It gets its name when it is whole.
"""

from pathlib import Path

import h5netcdf
import h5py
import numpy as np

from nrs_cosim.recordings.errors import UncreatableError, UnreadableError
from nrs_cosim.recordings.export.grids import DIMENSIONS, SECONDS, Array, Grids
from nrs_cosim.recordings.export.selection import ALL, NOTHING, Selected
from nrs_cosim.recordings.mcap.reader import Reader

_STORED = 2**17
"""Bytes of a variable that are compressed together, about: eight of them fit HDF5's cache."""
_TOGETHER = 2**22
"""Bytes that are written at once, about: every variable grows then, which takes its time."""
_COMPRESSED = {"compression": "gzip", "compression_opts": 1, "shuffle": True}


def write_netcdf(reader: Reader, path: Path, selection: Selected = ALL) -> None:
    """Write samples and states of a selection.

    `UncreatableError` when the file cannot be written, `UnreadableError` as `rows`.
    """
    grids, part = Grids(reader, selection), path.with_suffix(".part")
    try:
        try:
            with h5netcdf.File(part, "w") as file:
                _write(file, grids)
                if not any(file.dimensions[name].size for name in DIMENSIONS):
                    raise UnreadableError(f"{reader.path}: {NOTHING}")
            part.replace(path)
        finally:
            part.unlink(missing_ok=True)
    except OSError as error:
        raise UncreatableError(f"{path}: cannot be written: {error.strerror or error}") from None


def _write(file: h5netcdf.File, grids: Grids) -> None:
    fixed = {"robot": grids.robots, **grids.axes}
    file.dimensions = {**dict.fromkeys(DIMENSIONS), **{name: len(of) for name, of in fixed.items()}}
    for name in DIMENSIONS:
        times = file.create_variable(name, (name,), "f8", chunks=(_STORED // 8,), **_COMPRESSED)
        times.attrs.update(SECONDS)
    for name, numbers in fixed.items():
        file.create_variable(name, (name,), "i8", data=np.array(numbers))
    for name, texts in grids.joints.items():
        text = h5py.string_dtype()
        file.create_variable(name, ("robot", "joint"), text, data=np.array(texts, object))
    for name, of in grids.variables.items():
        at_once = max(_STORED // max(8 * int(np.prod(of.shape)), 1), 1)
        variable = file.create_variable(
            name,
            of.dimensions,
            "f8",
            chunks=(at_once, *of.shape),
            fillvalue=np.nan,
            **_COMPRESSED,
        )
        variable.attrs.update(of.attributes)
    file.attrs.update({**grids.attributes, "coordinates": " ".join(grids.joints)})
    waiting: dict[str, list[dict[str, Array]]] = {dimension: [] for dimension in DIMENSIONS}
    size = 0
    for dimension, times, values in grids.parts():
        waiting[dimension].append({dimension: times, **values})
        size += times.nbytes + sum(part.nbytes for part in values.values())
        if size >= _TOGETHER:
            _append(file, waiting)
            size = 0
    _append(file, waiting)


def _append(file: h5netcdf.File, waiting: dict[str, list[dict[str, Array]]]) -> None:
    """Write what waits of each dimension that grows."""
    for dimension, parts in waiting.items():
        if not parts:
            continue
        stored = file.dimensions[dimension].size
        file.resize_dimension(dimension, stored + sum(len(part[dimension]) for part in parts))
        for name in parts[0]:
            file.variables[name][stored:] = np.concatenate([part[name] for part in parts])
        parts.clear()
