"""The target in a scenario: a motion of sums of sines, through samples, or of an FMU."""

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Discriminator, Field, Tag

from nrs_cosim.orchestrator.scenario.tables.fmus import Fmu
from nrs_cosim.orchestrator.scenario.tables.values import (
    HARMONIC,
    MOVING,
    SAMPLED,
    Number,
    Positive,
    Table,
    Vector,
)


class Wave(Table):
    """amplitude · sin or cos (frequency t + phase)."""

    amplitude: Number = Field(description="of the wave, in the unit of what it is added to")
    frequency: Number = Field(description="rad/s")
    phase: Number = Field(0.0, description="rad")


class Axis(Table):
    """offset + rate t + Σ sines + Σ cosines."""

    offset: Number = Field(0.0, description="at t = 0, without the waves")
    rate: Number = Field(0.0, description="per second")
    sines: tuple[Wave, ...] = Field((), description="waves that are added")
    cosines: tuple[Wave, ...] = Field((), description="waves that are added")


def _target_kind(kind: Any) -> Any:
    if kind != "harmonic":  # the others have tables of their own
        raise ValueError("'harmonic', 'sampled' or 'fmu'")
    return kind


def _target_form(value: Any) -> str:
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    return {"sampled": SAMPLED, "fmu": MOVING}.get(str(kind), HARMONIC)


class HarmonicTarget(Table):
    """The target moves by a formula on each axis."""

    kind: Annotated[Literal["harmonic"], BeforeValidator(_target_kind)] = Field(
        "harmonic", description="a formula on each axis"
    )
    axes: tuple[Axis, ...] = Field(min_length=1, description="one for each of the m joints")

    @property
    def m(self) -> int:
        """The number of axes."""
        return len(self.axes)


class SampledTarget(Table):
    """The target moves along the cubic spline through what was sampled: in `file`, or given here.

    A file is read once, and its samples are recorded beside the scenario's text.
    """

    kind: Literal["sampled"] = Field(description="a spline through samples")
    file: str | None = Field(
        None,
        description="path relative to this file, .csv or .parquet: columns t (s) and position_1 … "
        "position_m; velocity_1 … velocity_m, where given, are checked against the spline's",
    )
    times: Vector = Field((), description="s; increasing, from 0 or before to the run's end")
    positions: tuple[Annotated[Vector, Field(min_length=1)], ...] = Field(
        (), description="one row of m numbers for each time"
    )

    @property
    def m(self) -> int:
        """The number of axes; 0 before a file is read."""
        return len(self.positions[0]) if self.positions else 0


class FmuTarget(Fmu):
    """The target moves as an FMU does that nothing drives, by its outputs position and velocity.

    It is run once, when a scenario is read, and what it did is recorded beside the scenario's text.
    """

    kind: Literal["fmu"] = Field(description="what an FMU does")
    step: Positive | None = Field(
        None,
        description="s; the longest between two samples of the FMU, which is sampled at all output "
        "times too; a quarter of each sampling period by default",
    )

    @property
    def m(self) -> int:
        """The number of axes, of which nothing is known before the FMU was run."""
        return 0


class FmuMotion(FmuTarget):
    """What the FMU did that is the target: no table of a file, but what becomes of one."""

    sha256: str
    """Of the FMU."""
    times: Vector
    """s, when it was sampled."""
    positions: tuple[Vector, ...]
    """One row of m numbers for each time, as of velocities."""
    velocities: tuple[Vector, ...]

    @property
    def m(self) -> int:
        """The number of axes."""
        return len(self.positions[0]) if self.positions else 0


TargetMotion = Annotated[
    Annotated[HarmonicTarget, Tag(HARMONIC)]
    | Annotated[SampledTarget, Tag(SAMPLED)]
    | Annotated[FmuTarget, Tag(MOVING)],
    Discriminator(_target_form),
]


TARGETS: dict[Any, type[Table]] = {
    HARMONIC: HarmonicTarget,
    SAMPLED: SampledTarget,
    MOVING: FmuTarget,
}
"""The target's tables by form."""
