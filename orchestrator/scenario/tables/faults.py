"""Faults in a scenario: of links, and of robots."""

from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag

from nrs_cosim.bus.lies import LieKind
from nrs_cosim.orchestrator.scenario.tables.algorithms import AlgorithmChoice
from nrs_cosim.orchestrator.scenario.tables.values import (
    BY_FIELD,
    DRAW,
    NUMBER,
    PERIODS,
    Count,
    Number,
    RobotNumber,
    Table,
    Weight,
)


def _delay_form(value: Any) -> str:
    return DRAW if isinstance(value, dict | WholeUniform) else PERIODS


def _each_form(value: Any) -> str:
    return BY_FIELD if isinstance(value, dict) else NUMBER


Periods = Annotated[Count, Field(le=1000)]
Extent = Annotated[Number, Field(ge=0, le=1e100)]
Span = tuple[Weight, Weight]


class WholeUniform(Table):
    """A seeded draw of a whole number."""

    uniform: tuple[Periods, Periods] = Field(description="[low, high], both included")


Delay = Annotated[
    Annotated[WholeUniform, Tag(DRAW)] | Annotated[Periods, Tag(PERIODS)],
    Discriminator(_delay_form),
]
Each = Annotated[
    Annotated[Extent, Tag(NUMBER)] | Annotated[dict[str, Extent], Tag(BY_FIELD)],
    Discriminator(_each_form),
]
"""One number for all fields that are sent, or one by field, 0 for those that are not named."""


Signed = Annotated[Number, Field(ge=-1e100, le=1e100)]
EachSigned = Annotated[
    Annotated[Signed, Tag(NUMBER)] | Annotated[dict[str, Signed], Tag(BY_FIELD)],
    Discriminator(_each_form),
]


class FaultyLink(Table):
    """What is wrong with some links; a later entry's keys replace an earlier one's."""

    from_: Count | None = Field(
        None, alias="from", description="a node, 0 is the target; all unless given"
    )
    to: Count | None = Field(None, description="a robot; all unless given")
    loss: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="the probability that a sample is lost"
    )
    duplicate: Annotated[Number, Field(ge=0, le=1)] = Field(
        0.0, description="the probability that a sample arrives twice, both at once"
    )
    delay: Delay = Field(0, description="sampling periods: a whole number or {uniform = [a, b]}")
    outages: tuple[Span, ...] = Field(
        (), description="s; [from, to]: samples of from <= t_k < to are lost"
    )
    noise: Each = Field(
        0.0,
        description="standard deviation of what is added to each number of a sample: a number, "
        "or {position = …, velocity = …}, by the fields that the algorithm sends",
    )
    quantisation: Each = Field(
        0.0,
        description="each number is rounded to a multiple of this, after the noise; as `noise`",
    )


class FaultyRobot(Table):
    """When a robot neither sends nor receives."""

    id: int = Field(strict=True, ge=1, description="1 to n")
    outages: tuple[Span, ...] = Field(
        (), description="s; [from, to]: at from <= t_k < to it neither sends nor receives"
    )


class ByzantineRobot(Table):
    """A lie that a robot tells of its samples; its own estimate and plant go on without it.

    Each lie is told of what the entries before it say; those to some robots, of what all are sent.
    """

    robot: int = Field(strict=True, ge=1, description="1 to n")
    kind: LieKind = Field(
        description="what is sent is `stuck` at a value, or has something added: an `offset`, a "
        "`ramp`, or `noise`, which is drawn at each t_k: once for all, or for each of `to`; or it "
        "is what another `algorithm` would send",
    )
    algorithm: AlgorithmChoice | None = Field(
        None,
        description="of kind `algorithm`: its name and parameters, as in `[algorithm]`; it sends "
        "the same fields, receives what the robot does, and starts as the robot does",
    )
    value: EachSigned | None = Field(
        None,
        description="where it is stuck (at what the robot starts with, unless given), the offset, "
        "the ramp's slope per s, or the standard deviation of the noise: a number, or "
        "{position = …, velocity = …}, by the fields that the algorithm sends, of which others "
        "are sent as they are",
    )
    to: Annotated[tuple[RobotNumber, ...], Field(min_length=1)] | None = Field(
        None,
        description="the robots that are told it, on their links; all of them unless given, and "
        "then the lie is the sample",
    )
    times: tuple[Span, ...] = Field(
        (), description="s; [from, to]: told at from <= t_k < to; always unless given"
    )


class Faults(Table):
    """What goes wrong between robots, by the seed and by the clock."""

    links: tuple[FaultyLink, ...] = Field((), description="of links; later entries replace keys")
    robots: tuple[FaultyRobot, ...] = Field((), description="of robots, an entry each")
    byzantine: tuple[ByzantineRobot, ...] = Field(
        (), description="of robots that lie; what is measured and proven is of the others"
    )
