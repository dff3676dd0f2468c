"""A recording as an xarray Dataset: the variables of `grids`, in memory."""

import numpy as np
import xarray

from nrs_cosim.recordings.export.grids import DIMENSIONS, SECONDS, Grids
from nrs_cosim.recordings.export.selection import ALL, Selected
from nrs_cosim.recordings.mcap.reader import Reader


def dataset(reader: Reader, selection: Selected = ALL) -> xarray.Dataset:
    """Return all samples and states of a recording, which must fit into memory twice.

    The unit of a variable is an attribute where all joints of all robots have the same. Raises
    `UnreadableError` as `rows` does.
    """
    grids = Grids(reader, selection)
    times = {dimension: [np.empty(0)] for dimension in DIMENSIONS}
    values = {name: [np.empty((0, *of.shape))] for name, of in grids.variables.items()}
    for dimension, at, found in grids.parts():
        times[dimension].append(at)
        for name, part in found.items():
            values[name].append(part)
    return xarray.Dataset(
        {
            name: (of.dimensions, np.concatenate(values.pop(name)), dict(of.attributes))
            for name, of in grids.variables.items()
        },
        {
            **{name: (name, np.concatenate(parts), SECONDS) for name, parts in times.items()},
            "robot": ("robot", grids.robots),
            **{name: (("robot", "joint"), of) for name, of in grids.joints.items()},
            **{
                axis: (axis, [*numbers])
                for axis, numbers in grids.axes.items()
                if "_axis_" not in axis
            },
        },
        grids.attributes,
    )
