"""A row of a study's table: what one run came to, in plain numbers and words.

    converged       completed, and the errors of the estimates fall, or stay as small as they are
    not_converged   completed, and they grow
    diverged        an estimate or a state went beyond run.divergence_limit
    failed          the run could not go on, or begin: `cause_kind` and `reason` say why
    timeout         it took longer than was allowed
    crashed         it ended its process, twice: the second time it was alone

The first three are results, the others are not. Two runs of a point have the same row but for
`OF_THE_MACHINE`, what of it is of the machine and the day.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted

RowStatus = Literal["converged", "not_converged", "diverged", "failed", "timeout", "crashed"]
STATUSES: tuple[str, ...] = get_args(RowStatus)
RESULTS = ("converged", "not_converged", "diverged")
FAILURES = ("failed", "timeout", "crashed")
QUANTITIES = ("position_estimate", "velocity_estimate", "position_tracking", "velocity_tracking")
"""Errors of estimates in the ∞-norm, and of robots in the 2-norm, in the last fifth of a run."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyRow:
    """One run; None is what is not known. Objects are JSON, so that a row is flat."""

    key: str
    point: str
    """Values by key of the axes, but for the seed."""
    scenario: str
    seed: int
    status: RowStatus
    cause_kind: str | None = None
    """As in `bus.errors.Cause`; `input` where the run could not begin."""
    cause_tick: int | None = None
    cause_time_ns: int | None = None
    cause_robot: int | None = None
    cause_quantity: str | None = None
    reason: str = ""
    digest: str | None = None
    ticks: int | None = None
    ticks_planned: int | None = None
    messages: int | None = None
    samples: int | None = None
    """What the robots sent."""
    position_estimate: float | None = None
    velocity_estimate: float | None = None
    position_tracking: float | None = None
    velocity_tracking: float | None = None
    measured_rate: float | None = None
    """By what the errors of the estimates are multiplied at a sampling time."""
    convergence: str | None = None
    """Of theory: `converges`, `diverges`, …; as `nrs check` has it."""
    spectral_radius: float | None = None
    spectral_radius_lower: float | None = None
    almost_sure: float | None = None
    """e^λ, which almost every run grows by, at most; by simulation where samples are lost."""
    almost_sure_lower: float | None = None
    margin: float | None = None
    """The smallest of the conditions, as a part of its bound; below 0 where one is violated."""
    critical_loss: float | None = None
    """The loss of links below which it converges in mean square, where links lose samples."""
    violated: str = ""
    """The conditions that are, by name."""
    why_no_bounds: str = ""
    bounds: str = "{}"
    """Of each quantity: `steady_state`, `worst_case` and `paper`, and how the run was beside."""
    versions: str = "{}"
    fmus: str = "{}"
    """SHA-256 of the plants' FMUs."""
    cpu_seconds: float | None = None
    """Of processor time, with all that the row took."""
    wall_seconds: float | None = None
    tries: int = 1
    host: str = ""
    pid: int | None = None
    started: str = ""
    recording: str | None = None
    """Its file, in the study's folder."""

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {name: getattr(self, name) for name in COLUMNS}

    @classmethod
    def of(cls, found: Mapping[str, Any]) -> "StudyRow":
        """Return the row of what JSON had; what is not known of an earlier version is left out."""
        return cls(**{name: found[name] for name in COLUMNS if name in found})


def _kind(of: Any) -> str:
    return next((one.__name__ for one in (int, float) if one in (get_args(of) or (of,))), "str")


COLUMNS = {field.name: _kind(field.type) for field in fields(StudyRow)}
"""`int`, `float` or `str`, by name; each may be None."""
OF_THE_MACHINE = (
    "fmus",
    "versions",
    "cpu_seconds",
    "wall_seconds",
    "tries",
    "host",
    "pid",
    "started",
    "recording",
)


def kept_recordings(option: str, text: str) -> str:
    """Return which recordings are kept; `InputError` for what an option does not take."""
    number = text.removeprefix("every:")
    if text not in {"none", "failed", "all"} and not (
        text != number and number.isascii() and number.isdecimal() and int(number) > 0
    ):
        raise InputError(f"{option}: expected none, failed, all or every:N, got {quoted(text)}")
    return text


def written_point(values: Mapping[str, Any]) -> str:
    """Return the values of a point as a row has them: JSON in the order of the axes."""
    return json.dumps(values, separators=(",", ":"), default=str)


def table_digest(rows: Iterable[StudyRow]) -> str:
    """Return the SHA-256 of rows, sorted by key, without what is of the machine."""
    kept = [name for name in COLUMNS if name not in OF_THE_MACHINE]
    digest = hashlib.sha256()
    for row in sorted(rows, key=lambda row: row.key):
        digest.update(json.dumps([getattr(row, name) for name in kept]).encode() + b"\n")
    return digest.hexdigest()
