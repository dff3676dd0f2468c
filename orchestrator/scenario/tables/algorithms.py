"""The table of the algorithm: its name, what its agents do without a sample, and its parameters.

The parameters are the fields of the class that `name` names, so each algorithm has a table of its
own, made of that class.
"""

import inspect
from collections.abc import Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal, Never, Self

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    JsonValue,
    PlainValidator,
    ValidationError,
    ValidationInfo,
    WithJsonSchema,
    create_model,
)
from pydantic_core import CoreSchema, core_schema

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.estimator_agents.algorithm import Algorithm, Missing
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.installed import (
    GROUP,
    algorithm_class,
    algorithm_names,
    is_installed,
    load_algorithm,
    parameters_of,
    policies_of,
)
from nrs_cosim.estimator_agents.parameters import Parameter
from nrs_cosim.orchestrator.scenario.tables.values import Table

_JSON = {float: "number", int: "integer", bool: "boolean", str: "string"}
_BOUNDS = {
    "above": "exclusiveMinimum",
    "least": "minimum",
    "below": "exclusiveMaximum",
    "most": "maximum",
}
ALGORITHM = "algorithm "
"""Begins the names, among a recording's versions, of packages whose algorithms were run."""
_OWN = "parameter_"
"""Begins the attribute of a parameter, which may be called as one of pydantic's own."""


class AlgorithmTable(Table):
    """The estimator and its parameters, which are the algorithm's own."""

    name: str = Field(description="dcea1, dcea2, or the name of another installed algorithm")
    missing: Missing | None = Field(
        None,
        description="without a neighbour's sample an agent goes by the last one (hold), or without "
        "that neighbour (drop); by default the first that the algorithm knows",
    )

    @property
    def parameters(self) -> dict[str, Any]:
        """The value of each of the algorithm's parameters, by name, as its class declares them."""
        keys = [key for key in type(self).model_fields if key.startswith(_OWN)]
        return {key.removeprefix(_OWN): getattr(self, key) for key in keys}

    def loaded(self) -> Algorithm:
        """Return the algorithm; `InputError` where it does not take its parameters."""
        return load_algorithm(self.name, self.parameters)

    @property
    def policy(self) -> Missing:
        """What an agent does without an in-neighbour's sample."""
        return self.missing or policies_of(self.name)[0]


def _installed(name: str) -> str:
    if not is_installed(name):
        raise ValueError(f"one of {', '.join(algorithm_names())}, or one of a package to install")
    return name


class _Unknown(AlgorithmTable):
    """Of an algorithm that there is not, whose parameters nobody knows."""

    model_config = ConfigDict(extra="ignore")

    name: Annotated[str, Field(strict=True), AfterValidator(_installed)]


class NotInstalled(AlgorithmTable):
    """Of an algorithm that is not here as it was recorded: what its run gave, whatever that is."""

    model_config = ConfigDict(extra="allow")
    _package: str = ""
    """Which package it was of, its version and entry point; empty where that is not known."""

    @classmethod
    def recorded(cls, value: Any, versions: Mapping[str, str]) -> Self:
        """Return the table of a run that was recorded with such versions."""
        table = cls.model_validate(value)
        table._package = versions.get(ALGORITHM + table.name, "")
        return table

    @property
    def parameters(self) -> dict[str, Any]:
        """The values that were given, by name."""
        return dict(self.model_extra or {})

    def loaded(self) -> Never:
        """Raise `InputError`."""
        raise self.why_not()

    def why_not(self) -> InputError:
        """Return what of the recording the algorithm that is installed does not take."""
        if is_installed(self.name):
            try:
                table_for({"name": self.name}).model_validate(self.model_dump(exclude_unset=True))
            except ValidationError as error:
                fault = error.errors(include_url=False, include_context=False)[0]
                field = ".".join(["algorithm", *map(str, fault["loc"])])
                return InputError(
                    f"{field}: {fault['msg'][0].lower()}{fault['msg'][1:]}: another version of "
                    f"{self.name} is installed than the recording is of"
                    + f"; install {self._package}"
                    * bool(self._package)
                )
            except AlgorithmError as error:
                return error
        package = self._package or f"the package that has it as an entry point of {GROUP}"
        return InputError(
            f"algorithm.name: {quoted(self.name)} is not installed as it was recorded; install "
            f"{package}"
        )


def table_for(value: Any) -> type[AlgorithmTable]:
    """Return the table that a value of `[algorithm]` is to be, by its name."""
    name = value.get("name") if isinstance(value, dict) else None
    if not isinstance(name, str) or not is_installed(name):
        return _Unknown
    kind: Any = algorithm_class(name)
    return _table(name, kind)


@lru_cache
def _table(name: str, kind: Any) -> type[AlgorithmTable]:
    about = (inspect.getdoc(kind) or "").partition("\n\n")[0]
    keys: dict[str, Any] = {f"{_OWN}{one.name}": _key(one) for one in parameters_of(name)}
    return create_model(
        f"Algorithm {name}",
        __base__=AlgorithmTable,
        __doc__="" if about.startswith(f"{kind.__name__}(") else about,  # as a dataclass's own is
        **keys,
        **_named(name),
    )


def _named(name: str) -> dict[str, Any]:
    return {"name": (Literal[name], Field(description="the algorithm"))}


def _key(one: Parameter) -> tuple[Any, Any]:
    """Return a parameter as a key of a table."""
    bounds = {_BOUNDS[name]: bound for name, bound in one.declared.bounds.items()}
    schema = {"type": _JSON[one.kind], **bounds}
    if one.choices:
        schema["enum"] = [*one.choices]
    more: dict[str, JsonValue] = {"unit": one.declared.unit} if one.declared.unit else {}
    return (
        Annotated[Any, PlainValidator(one.value), WithJsonSchema(schema)],
        Field(
            ... if one.required else one.value(one.default),
            alias=one.name,
            description=one.declared.meaning or None,
            json_schema_extra=more,
        ),
    )


_OTHER_VERSION = {"extra_forbidden", "missing"}
"""What another version of an algorithm may come to: it has other parameters."""


def _checked(value: Any, info: ValidationInfo) -> AlgorithmTable:
    """Read the table; where the context has a recording's versions it need not be installed."""
    if isinstance(value, AlgorithmTable):
        return value
    if info.context is None:
        return table_for(value).model_validate(value)
    try:
        table = table_for(value)
    except AlgorithmError:  # its class cannot be used here
        table = _Unknown
    if table is _Unknown:
        return NotInstalled.recorded(value, info.context)
    try:
        return table.model_validate(value)
    except ValidationError as error:
        if {fault["type"] for fault in error.errors()} <= _OTHER_VERSION:
            return NotInstalled.recorded(value, info.context)
        raise


class _ByName:
    """The table of the algorithm that is named; in a schema one of those that are installed."""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.with_info_plain_validator_function(_checked)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        tables = {name: _shown(name).__pydantic_core_schema__ for name in algorithm_names()}
        return handler(core_schema.tagged_union_schema(tables, discriminator="name"))


def _shown(name: str) -> type[BaseModel]:
    """Return an algorithm's table; where its class is wrong, one that says so and takes any key."""
    try:
        return table_for({"name": name})
    except AlgorithmError as error:
        return create_model(
            f"Algorithm {name}",
            __config__=ConfigDict(extra="allow"),
            __doc__=str(error),
            **_named(name),
        )


AlgorithmChoice = Annotated[AlgorithmTable, _ByName()]
