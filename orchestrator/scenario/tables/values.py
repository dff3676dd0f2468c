"""Values of a scenario's tables: numbers, and forms of which one is written.

n is the number of robots and m the number of the target's axes.
"""

from math import isfinite
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    Tag,
    ValidationInfo,
)
from pydantic_core import CoreSchema, core_schema

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
Weight = Annotated[Number, Field(ge=0)]
Count = Annotated[int, Field(strict=True, ge=0)]
Tick = Annotated[int, Field(strict=True, ge=1)]
MOST_ROBOTS = 100_000
Node = Annotated[int, Field(strict=True, ge=0, le=MOST_ROBOTS)]
RobotNumber = Annotated[int, Field(strict=True, ge=1, le=MOST_ROBOTS)]
Text = Annotated[str, Field(strict=True)]
Vector = tuple[Number, ...]
Matrix = tuple[Vector, ...]


class Table(BaseModel):
    """A table whose keys are all known."""

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)


class WhenGiven:
    """Of a key with a table that most scenarios have not: its schema is built where it is given."""

    def __init__(self, table: type[Table]) -> None:
        self._table = table

    def __get_pydantic_core_schema__(self, _: Any, _handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(self._read)

    def __get_pydantic_json_schema__(
        self, _: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        return handler(self._table.__pydantic_core_schema__)

    def _read(self, value: Any, info: ValidationInfo) -> Table:
        return self._table.model_validate(value, context=info.context)


NUMBER, TRUTH, TEXT = "a number", "true or false", "a text"
VECTOR, MATRIX = "a list of numbers", "a list of lists of numbers"
NESTED = "lists of numbers, in one another"
VALUES, ROWS, NAMES = "a list", "a list of lists", "a list of names"
DRAW, PATTERN = "{uniform = [low, high]}", "{pattern = …, base = …}"
PERIODS, BY_FIELD = "a whole number", "{position = …, velocity = …}"
HARMONIC, SAMPLED, MOVING = "a harmonic target", "a sampled target", "an FMU as target"
EDGE, WEIGHTED = "[source, sink]", "[source, sink, weight]"
FORMS = frozenset(
    {NUMBER, TRUTH, TEXT, VECTOR, MATRIX, NESTED, VALUES, ROWS, NAMES, DRAW, PATTERN, PERIODS}
    | {BY_FIELD, HARMONIC, SAMPLED, MOVING, EDGE, WEIGHTED}
)


def _form(value: Any) -> str:
    """Return which form of a value was written, so that its errors speak of that form alone."""
    if isinstance(value, dict | Uniform):
        return DRAW
    if isinstance(value, int | float):
        return NUMBER
    if not isinstance(value, list | tuple):
        return ""
    return MATRIX if any(isinstance(row, list | tuple) for row in value) else VECTOR


def _array_form(value: Any) -> str:
    if isinstance(value, dict | Uniform):
        return DRAW
    return NESTED if isinstance(value, list | tuple) else NUMBER


def _numbers(value: Any) -> Any:
    """Return lists of numbers in one another, as tuples."""
    if isinstance(value, list | tuple):
        return tuple(_numbers(item) for item in value)
    if isinstance(value, bool) or not isinstance(value, int | float) or not isfinite(value):
        raise ValueError("lists of finite numbers, in one another")
    return float(value)


class Uniform(Table):
    """A seeded draw of every component."""

    uniform: tuple[Number, Number] = Field(description="[low, high)")


Gain = Annotated[
    Annotated[Number, Tag(NUMBER)]
    | Annotated[Vector, Tag(VECTOR)]
    | Annotated[Matrix, Tag(MATRIX)],
    Discriminator(_form),
]
JointNumbers = Annotated[
    Annotated[Positive, Tag(NUMBER)] | Annotated[tuple[Positive, ...], Tag(VECTOR)],
    Discriminator(_form),
]
"""A number for all joints, or one for each."""


def _limit_form(value: Any) -> str:
    return TEXT if isinstance(value, str) else _form(value)


TorqueLimit = Annotated[
    Annotated[Positive, Tag(NUMBER)]
    | Annotated[tuple[Positive, ...], Tag(VECTOR)]
    | Annotated[Literal["effort"], Tag(TEXT)],
    Discriminator(_limit_form),
]
InitialRows = Annotated[
    Annotated[Number, Tag(NUMBER)]
    | Annotated[Vector, Tag(VECTOR)]
    | Annotated[Matrix, Tag(MATRIX)]
    | Annotated[Uniform, Tag(DRAW)],
    Discriminator(_form),
]
InitialRow = Annotated[
    Annotated[Number, Tag(NUMBER)] | Annotated[Vector, Tag(VECTOR)] | Annotated[Uniform, Tag(DRAW)],
    Discriminator(_form),
]
InitialArray = Annotated[
    Annotated[Number, Tag(NUMBER)]
    | Annotated[tuple[Any, ...], AfterValidator(_numbers), Tag(NESTED)]
    | Annotated[Uniform, Tag(DRAW)],
    Discriminator(_array_form),
]
