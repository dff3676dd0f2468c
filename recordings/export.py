"""A recording's tables as CSV: floats in their shortest form that reads back to the same bits.

`samples.csv` has the left limits at t_k, a row a node (robot 0 is the target) and sampling time;
`states.csv` has a row a robot and output time. Both are sorted by time, then robot. A table gets
its name when it is whole.
"""

import csv
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bus.messages import SAMPLE, STATE
from recordings.errors import UncreatableError
from recordings.reading import Reader
from recordings.tables import joints, samples, states


def export_csv(reader: Reader, folder: Path) -> list[Path]:
    """Write `samples.csv` and `states.csv` into a folder, made if need be; return their paths."""
    m = joints(reader)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        return [
            _write(folder / "samples.csv", ["k", "t", "robot"], SAMPLE.vectors, m, samples(reader)),
            _write(folder / "states.csv", ["t", "robot"], STATE.vectors, m, states(reader)),
        ]
    except OSError as error:
        raise UncreatableError(f"{folder}: cannot be written: {error.strerror}") from None


def _write(
    path: Path,
    scalars: list[str],
    vectors: Sequence[str],
    m: int,
    tables: Iterable[NDArray[np.void]],
) -> Path:
    part = path.with_suffix(".part")
    with part.open("w", newline="", encoding="ascii") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(scalars + [f"{name}_{i}" for name in vectors for i in range(1, m + 1)])
        for table in tables:
            table = table[np.lexsort((table["robot"], table["time_ns"]))]  # noqa: PLW2901
            columns = {
                "k": table["k"].tolist(),
                "t": (table["time_ns"] / 1e9).tolist(),
                "robot": table["robot"].tolist(),
            }
            numbers = np.concatenate([table[name] for name in vectors], axis=1).tolist()
            heads = zip(*(columns[name] for name in scalars), strict=True)
            rows.writerows([*head, *row] for head, row in zip(heads, numbers, strict=True))
    return part.replace(path)
