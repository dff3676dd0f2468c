"""A scenario's text holds all that decides a run: what it named as a file stands in it, as numbers.

Workers elsewhere, resumed runs and replays are given the text alone. A number in it is the shortest
that reads as the same float, so nothing is rounded on the way.
"""

import re
import tomllib
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.estimator_agents.target import Sampled
from nrs_cosim.orchestrator.errors import ScenarioError

Array = NDArray[np.float64]

APART = 0.05
"""How far a sampled velocity may be from the spline's, as a part of the largest sampled."""
_VECTOR = r"(position|velocity)_[0-9]+"


def inline_target(text: str, folder: Path, origin: str) -> str:
    """Return a scenario's text with its target's samples in place of the name of their file.

    Any other text is returned as it is, with all that may be wrong in it. Errors begin with
    `origin`.
    """
    name = _file_of(text)
    if name is None:
        return text
    import tomlkit  # noqa: PLC0415, 0.05 s that other texts need not wait for

    try:
        times, positions = _samples(folder / name)
    except InputError as error:
        raise ScenarioError(f"{origin}: target.file: {error}") from None
    document = tomlkit.parse(text)
    target: Any = document["target"]
    given = [key for key in ("times", "positions") if key in target]
    if given:
        raise ScenarioError(
            f"{origin}: target.file: got {quoted(name)} and target.{given[0]} too; give one of them"
        )
    del target["file"]
    target["times"] = tomlkit.value(written(times.tolist()))
    target["positions"] = tomlkit.value(written(positions.tolist()))
    return tomlkit.dumps(document)


def _file_of(text: str) -> str | None:
    """Return the name of the file of a sampled target."""
    try:
        target = tomllib.loads(text).get("target")
    except (ValueError, RecursionError):
        return None
    if not isinstance(target, dict) or target.get("kind") != "sampled":
        return None
    name = target.get("file")
    return name if isinstance(name, str) else None


def written(rows: list[Any]) -> str:
    """Return rows as TOML."""
    return "\n".join(["[", *(f"  {row!r}," for row in rows), "]"])


def _samples(path: Path) -> tuple[Array, Array]:
    """Return times (s,) and positions (s, m) of a file, whose velocities agree with them."""
    from nrs_cosim.recordings.input_tables import read_columns  # noqa: PLC0415, as above

    found = read_columns(path)
    for name in ("t", "position_1"):
        if name not in found:
            raise InputError(
                f"{path}: expected columns t and position_1 … position_m, got "
                f"{', '.join(found) or 'none'}, without {name}"
            )
    kinds = [name.partition("_")[0] for name in found if re.fullmatch(_VECTOR, name)]
    m = kinds.count("position")
    wanted = {kind: [f"{kind}_{i}" for i in range(1, m + 1)] for kind in sorted({*kinds})}
    for kind, those in wanted.items():
        lacking = [name for name in those if name not in found]
        if lacking or kinds.count(kind) > m:
            without = f", without {lacking[0]}" if lacking else ""
            raise InputError(
                f"{path}: expected {those[0]} … {those[-1]}, as many velocities as positions if "
                f"any, got {kinds.count(kind)}{without}"
            )
    for name in ["t", *chain(*wanted.values())]:
        bad = np.flatnonzero(~np.isfinite(found[name]))
        if len(bad):
            raise InputError(
                f"{path}: {name} of sample {bad[0]}: expected a finite number, "
                f"got {found[name][bad[0]]}"
            )
    times = found["t"]
    vectors = {
        kind: np.stack([found[name] for name in names], axis=1) for kind, names in wanted.items()
    }
    if "velocity" in vectors and len(times) > 1 and np.all(np.diff(times) > 0):
        _expect_agreement(path, times, vectors["position"], vectors["velocity"])
    return times, vectors["position"]


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


def _expect_agreement(path: Path, times: Array, positions: Array, velocities: Array) -> None:
    if found := disagreement(times, positions, velocities):
        raise InputError(
            f"{path}: velocity_{found.axis + 1} of sample {found.row}: expected "
            f"{found.expected:g} as the positions have it, within {found.tolerance:g}, got "
            f"{found.got:g}; sample more often, or leave the velocities out"
        )
