"""FMUs in a scenario: a file, what it is told, and what it calls things."""

from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    Discriminator,
    Field,
    Tag,
    ValidatorFunctionWrapHandler,
    WrapValidator,
)

from nrs_cosim.orchestrator.scenario.tables.values import (
    NAMES,
    NUMBER,
    PATTERN,
    ROWS,
    TEXT,
    TRUTH,
    VALUES,
    Number,
    Positive,
    Table,
    Text,
)


def _parameter_form(value: Any) -> str:
    if isinstance(value, list | tuple):
        return ROWS if any(isinstance(row, list | tuple) for row in value) else VALUES
    return {bool: TRUTH, str: TEXT}.get(type(value), NUMBER)


def _name_form(value: Any) -> str:
    if isinstance(value, dict | Pattern):
        return PATTERN
    return NAMES if isinstance(value, list | tuple) else TEXT


def _indexed(pattern: str) -> str:
    if "{i}" not in pattern:
        raise ValueError("a name with {i} for the index, and {j} for a second one")
    return pattern


def _not_empty(names: tuple[str, ...]) -> tuple[str, ...]:
    if not names:
        raise ValueError("at least one name")
    return names


def _whole_or(value: Any, number: ValidatorFunctionWrapHandler) -> float | int:
    """Leave a whole number what it is, for an FMU may ask for one."""
    return value if type(value) is int else number(value)


class Pattern(Table):
    """Names that differ in an index alone: joint1.phi, joint2.phi, …"""

    pattern: Annotated[str, AfterValidator(_indexed)] = Field(
        description="a name with {i} for the index, and {j} for a second one"
    )
    base: Literal[0, 1] = Field(1, description="what the index counts from")


Exact = Annotated[Number, WrapValidator(_whole_or)]
Entry = Annotated[
    Annotated[Exact, Tag(NUMBER)] | Annotated[bool, Tag(TRUTH)] | Annotated[Text, Tag(TEXT)],
    Discriminator(_parameter_form),
]
Parameter = Annotated[
    Annotated[Exact, Tag(NUMBER)]
    | Annotated[bool, Tag(TRUTH)]
    | Annotated[Text, Tag(TEXT)]
    | Annotated[tuple[Entry, ...], Tag(VALUES)]
    | Annotated[tuple[tuple[Entry, ...], ...], Tag(ROWS)],
    Discriminator(_parameter_form),
]
Name = Annotated[
    Annotated[Text, Tag(TEXT)]
    | Annotated[tuple[Text, ...], AfterValidator(_not_empty), Tag(NAMES)]
    | Annotated[Pattern, Tag(PATTERN)],
    Discriminator(_name_form),
]


class ParameterFile(dict[str, Any]):
    """Parameters that are in a file, and not known before a scenario is resolved."""

    def __init__(self, file: str) -> None:
        super().__init__()
        self.file = file


def _table_or_file(value: Any, table: ValidatorFunctionWrapHandler) -> Any:
    if not isinstance(value, str):
        return value if isinstance(value, ParameterFile) else table(value)
    if not value.lower().endswith(".ssv"):
        raise ValueError("a table of parameters, or the path of an .ssv file")
    return ParameterFile(value)


def _or_file(schema: dict[str, Any]) -> None:
    """Let an editor take the path of a file as well."""
    inner = {key: schema.pop(key) for key in ("type", "additionalProperties") if key in schema}
    schema["anyOf"] = [inner, {"type": "string", "pattern": "\\.ssv$"}]


class Fmu(Table):
    """An FMU, and what it is told."""

    fmu: str = Field(description="a bundled model, or the path of an .fmu relative to this file")
    parameters: Annotated[dict[str, Parameter], WrapValidator(_table_or_file)] = Field(
        {},
        description="of the FMU, by name, in its units; or the path of an .ssv file (SSP 1.0) that "
        "has them, relative to this file",
        json_schema_extra=_or_file,
    )
    variables: dict[str, Name] = Field(
        {},
        description="what the FMU has for q, qd, tau …, or in a target for position and velocity, "
        "where that is not found by itself, and q_start and qd_start where parameters say where "
        "these start: a name, the stem of a family, a slice such as x[0:2], "
        "a list of names, or a pattern",
    )
    isolate: bool = Field(
        True, strict=True, description="run a third-party FMU in a process of its own"
    )
    deadline: Positive = Field(
        10.0, description="s of wall time; an isolated FMU that takes longer for a call is ended"
    )


class Plant(Fmu):
    """A robot's dynamics."""

    solver: Literal["cvode", "rk4"] | None = Field(
        None, description="of Model Exchange; by default the most accurate way that the FMU offers"
    )
    rtol: Annotated[Number, Field(ge=1e-13, le=1e-2)] | None = Field(
        None, description="of cvode, relative; 1e-9 by default"
    )
    step: Positive | None = Field(None, description="s; the longest of rk4, 0.005 by default")
    control: Literal["hold", "heun"] | None = Field(
        None, description="of a torque from outside, in Co-Simulation: held, or corrected once"
    )
    control_step: Positive | None = Field(
        None, description="s; the longest for which a torque is held, 0.005 by default"
    )
    threads: bool = Field(
        False,
        strict=True,
        description="let several threads step a third-party FMU too (`--threads`), whose instances "
        "then must share nothing that changes: ask its author, it is not seen from outside",
    )


class OwnPlant(Plant):
    """What one robot's plant has of its own."""

    fmu: str | None = Field(  # type: ignore[assignment]
        None,
        description="another FMU; with it nothing of [plant] holds, without it the keys that are "
        "not given here are those of [plant]",
    )
