"""Samples of a target's motion as a table: columns t, position_1 … and, perhaps, velocity_1 ….

A number in a table that is written is the shortest that reads as the same float, so nothing is
rounded on the way.
"""

import re
from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.estimator_agents.target import Sampled

if TYPE_CHECKING:
    from nrs_cosim.recordings.input_tables import Columns

Array = NDArray[np.float64]

APART = 0.05
"""How far a sampled velocity may be from the spline's, as a part of the largest sampled."""
_VECTOR = r"(position|velocity)_[0-9]+"


@dataclass(frozen=True, slots=True, eq=False)
class Samples:
    """Times (s,) in s, positions and velocities (s, m)."""

    times: Array
    positions: Array
    velocities: Array | None

    @classmethod
    def read(cls, data: bytes, name: str, *, is_asset: bool = False) -> "Samples":
        """Read a file, .csv or .parquet by its name, or an asset; `InputError` begins with it."""
        from nrs_cosim.recordings.input_tables import csv_columns, file_columns  # noqa: PLC0415, MCAP

        columns = (csv_columns if is_asset else file_columns)(data, name)
        try:
            return cls._of(columns)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None

    @classmethod
    def _of(cls, columns: "Columns") -> "Samples":
        for name in ("t", "position_1"):
            if name not in columns:
                raise InputError(
                    f"expected columns t and position_1 … position_m, got "
                    f"{', '.join(columns) or 'none'}, without {name}"
                )
        kinds = [name.partition("_")[0] for name in columns if re.fullmatch(_VECTOR, name)]
        m = kinds.count("position")
        wanted = {kind: [f"{kind}_{i}" for i in range(1, m + 1)] for kind in sorted({*kinds})}
        for kind, those in wanted.items():
            lacking = [name for name in those if name not in columns]
            if lacking or kinds.count(kind) > m:
                without = f", without {lacking[0]}" if lacking else ""
                raise InputError(
                    f"expected {those[0]} … {those[-1]}, as many velocities as positions if any, "
                    f"got {kinds.count(kind)}{without}"
                )
        for name in ["t", *chain(*wanted.values())]:
            bad = np.flatnonzero(~np.isfinite(columns[name]))
            if len(bad):
                raise InputError(
                    f"{name} of sample {bad[0]}: expected a finite number, "
                    f"got {columns[name][bad[0]]}"
                )
        vectors = {
            kind: np.stack([columns[name] for name in names], axis=1)
            for kind, names in wanted.items()
        }
        return cls(columns["t"], vectors["position"], vectors.get("velocity"))

    def written(self) -> bytes:
        """Return the table as CSV."""
        vectors = {"position": self.positions, "velocity": self.velocities}
        given = {kind: rows for kind, rows in vectors.items() if rows is not None}
        names = [f"{kind}_{i + 1}" for kind, rows in given.items() for i in range(rows.shape[1])]
        table = np.column_stack([self.times, *given.values()]).tolist()
        lines = (",".join(map(repr, row)) for row in table)
        return ("\n".join([",".join(["t", *names]), *lines]) + "\n").encode()

    def expect_agreement(self, name: str) -> None:
        """Raise `InputError` unless velocities, where there are any, are those of the positions."""
        increasing = len(self.times) > 1 and np.all(np.diff(self.times) > 0)
        if self.velocities is None or not increasing:  # the latter is told elsewhere
            return
        if found := disagreement(self.times, self.positions, self.velocities):
            raise InputError(
                f"{name}: velocity_{found.axis + 1} of sample {found.row}: expected "
                f"{found.expected:g} as the positions have it, within {found.tolerance:g}, got "
                f"{found.got:g}; sample more often, or leave the velocities out"
            )


@dataclass(frozen=True, slots=True)
class VelocityMismatch:
    """Where a velocity is farthest from that of the spline through the positions."""

    row: int
    axis: int
    expected: float
    got: float
    tolerance: float

    @property
    def apart(self) -> float:
        """How far."""
        return abs(self.expected - self.got)


def disagreement(times: Array, positions: Array, velocities: Array) -> VelocityMismatch | None:
    """Return where velocities are not those of the spline through the positions, both (s, m)."""
    with np.errstate(all="ignore"):
        moved = Sampled.of(times, positions).at(times).velocity
        apart = np.abs(moved - velocities)
    rounding = 1e-12 * np.abs(positions).max() / np.diff(times).min()
    most = APART * np.abs(velocities).max() + rounding
    if np.all(apart <= most):
        return None
    row, axis = np.unravel_index(int(np.nanargmax(apart)), apart.shape)
    expected, got = moved[row, axis], velocities[row, axis]
    return VelocityMismatch(int(row), int(axis), float(expected), float(got), float(most))
