"""A scenario file is read once; every error names the field, the value and what was expected."""

import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.plurals import any_of
from nrs_cosim.bus.text import close, nearest, not_utf8, quoted, shortened, storable
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.assets import NO_ASSETS, Assets
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.resolution import Resolution
from nrs_cosim.orchestrator.scenario.tables.algorithms import AlgorithmTable, table_for
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.orchestrator.scenario.tables.scenario import Controller, Run, Scenario
from nrs_cosim.orchestrator.scenario.tables.targets import TARGETS, FmuMotion, FmuTarget
from nrs_cosim.orchestrator.scenario.tables.values import FORMS
from nrs_cosim.orchestrator.scenario.targets import wrong_target
from nrs_cosim.orchestrator.scenario.wrong_tables import unknown, unknown_variables, wrong_tables
from nrs_cosim.orchestrator.scenario.wrong_text import wrong_toml

if TYPE_CHECKING:
    from nrs_cosim.orchestrator.scenario.changes import Change

RECORDING = b"\x89MCAP"
"""How a recording begins; what knows the rest of it takes time to load."""


Tables = Mapping[str, Any]
"""A scenario as it was written, before it is checked."""
_OF_ALL_ROBOTS = (
    "the algorithm and its parameters are those of all robots; give them in [algorithm]"
)

STDIN = Path("-")
"""Stands for standard input, where a command takes a scenario file."""


def read_scenario(path: Path, changes: "Sequence[Change]" = ()) -> Experiment:
    """Read a scenario file, or standard input, with changes; `ScenarioError` when it is wrong."""
    if path == STDIN:
        text, name, folder = _decoded(sys.stdin.buffer.read(), scenario_name(path)), "stdin", Path()
    else:
        text, name, folder = read_text(path), storable(path.stem), path.parent
    origin = scenario_name(path)
    return resolve_scenario(_changed(text, changes, origin), name, folder, origin)


def scenario_name(path: Path) -> str:
    """Return what a scenario's file is called in what is said of it."""
    return "standard input" if path == STDIN else str(path)


def changed(experiment: Experiment, changes: "Sequence[Change]") -> Experiment:
    """Return an experiment with changes; `InputError` and `ScenarioError` name what is wrong."""
    text = _changed(experiment.text, changes, experiment.name)
    one, origin = experiment, "the changed scenario"
    return parse_scenario(text, one.name, one.folder, origin, one.assets)


def _changed(text: str, changes: "Sequence[Change]", origin: str) -> str:
    if not changes:
        return text
    from nrs_cosim.orchestrator.scenario.changes import with_changes  # noqa: PLC0415, it loads tomlkit

    try:
        return with_changes(text, changes)
    except InputError as error:
        raise InputError(f"{origin}: {error}") from None


def resolve_scenario(
    text: str,
    name: str,
    folder: Path,
    origin: str,
    assets: Assets = NO_ASSETS,
    tables: Tables | None = None,
) -> Experiment:
    """Parse a scenario's text with what it names, relative to a folder; errors as of its origin.

    What is not among the assets is read, and an FMU that is the target is run. `tables` are those
    of the text, where who wrote it has them.
    """
    return _resolved(text, name, folder, origin, Resolution(folder, assets), tables=tables)


def parse_scenario(
    text: str,
    name: str,
    folder: Path,
    origin: str,
    assets: Assets = NO_ASSETS,
    *,
    recorded: Mapping[str, str] | None = None,
) -> Experiment:
    """Parse a scenario's text that names no more than there is among the assets; reads no file.

    The algorithm of a recorded one need not be installed: only what asks for it then fails, and
    names the package that `recorded`, the versions of then, have.
    """
    return _resolved(text, name, folder, origin, Resolution(None, assets), recorded=recorded)


def read_text(path: Path) -> str:
    """Return the text of a scenario file; `ScenarioError` when there is none."""
    try:
        return _decoded(path.read_bytes(), str(path))
    except FileNotFoundError:
        raise ScenarioError(f"{path}: no such file") from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None


def _decoded(data: bytes, origin: str) -> str:
    """Return the text that a file has, to the byte."""
    if data.startswith(RECORDING):
        raise ScenarioError(f"{origin}: is a recording (MCAP), not a scenario; `nrs info` reads it")
    try:
        return data.decode()
    except UnicodeDecodeError as error:
        raise ScenarioError(f"{origin}: cannot be read: {not_utf8(error)}") from None


def tables_of(text: str) -> dict[str, Any]:
    """Return the tables of a text in TOML; a byte order mark is passed over."""
    return tomllib.loads(text.removeprefix("\ufeff"))


def _resolved(
    text: str,
    name: str,
    folder: Path,
    origin: str,
    resolution: Resolution,
    *,
    recorded: Mapping[str, str] | None = None,
    tables: Tables | None = None,
) -> Experiment:
    """Return the experiment that a text is; `ScenarioError` names all that is wrong with it."""
    scenario = resolution.tables(_parsed(text, origin, recorded, tables))
    _expect_none(resolution.faults, origin)
    experiment = Experiment(scenario, text, name, folder, resolution.assets)
    target = scenario.target
    if isinstance(target, FmuTarget) and not isinstance(target, FmuMotion):
        from nrs_cosim.orchestrator.scenario.target_motion import with_motion  # noqa: PLC0415, FMPy

        experiment = with_motion(experiment, target, origin)
    _expect_none(list(wrong_target(experiment)) or list(wrong_tables(experiment)), origin)
    return experiment


def _expect_none(faults: Sequence[str], origin: str) -> None:
    if faults:
        raise ScenarioError("\n".join(f"{origin}: {fault}" for fault in faults))


def _parsed(
    text: str, origin: str, context: Mapping[str, str] | None, given: Tables | None
) -> Scenario:
    try:
        tables = given or tables_of(text)
        if not tables:
            raise ScenarioError(f"{origin}: is empty; a scenario has {', '.join(_needed())}")
        return Scenario.model_validate(tables, context=context)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{origin}: {wrong_toml(text, str(error))}") from None
    except RecursionError:
        raise ScenarioError(f"{origin}: not valid TOML: nested too deeply") from None
    except ValidationError as error:
        faults = [_describe(fault, tables) for fault in _each_once(error.errors(), tables)]
        raise ScenarioError("\n".join(f"{origin}: {fault}" for fault in faults)) from None
    except ValueError as error:  # a number of more digits than Python reads
        raise ScenarioError(f"{origin}: not valid TOML: {error}") from None


def parse_plant(plant: Tables, origin: str) -> Plant:
    """Return a plant of tables alone, with no scenario; `ScenarioError` names its keys."""
    try:
        parsed = Plant.model_validate(plant)
    except ValidationError as error:
        found = [{**fault, "loc": ("plant", *fault["loc"])} for fault in error.errors()]
        _expect_none([_describe(fault, {"plant": plant}) for fault in found], origin)
        raise
    _expect_none([f"plant.{fault}" for fault in unknown_variables(parsed)], origin)
    return parsed


def _needed() -> list[str]:
    """Return the tables without which there is no scenario."""
    return [f"[{name}]" for name, field in Scenario.model_fields.items() if field.is_required()]


def _each_once(faults: Sequence[Any], given: Tables) -> Iterator[Any]:
    """Yield pydantic's errors without those keys that are missing because they are misspelt."""
    meant: set[tuple[int | str, ...]] = set()
    for fault in faults:
        if fault["type"] == "extra_forbidden":
            *table, name = fault["loc"]
            meant |= {(*table, key) for key in close(str(name), _keys_at(table, given))}
    for fault in faults:
        if fault["type"] != "missing" or fault["loc"] not in meant:
            yield fault


def _describe(fault: Any, given: Tables) -> str:
    """Turn one of pydantic's errors into `field: expected …, got …`."""
    path = [part for part in fault["loc"] if part not in FORMS]
    field, value, kind = _dotted(path), fault["input"], fault["type"]
    if kind == "extra_forbidden":
        *table, name = fault["loc"]
        if (table[:1], name) == (["robots"], "algorithm"):
            return f"{field}: unknown key; {_OF_ALL_ROBOTS}"
        inner = [] if table else [f"{one}.{name}" for one in _tables_with(str(name), given)]
        if inner:
            return f"{field}: unknown key; did you mean {' or '.join(map(repr, inner))}?"
        return f"{field}: unknown key{nearest(str(name), _keys_at(table, given))}"
    if path[-3:-1] == ["plant", "variables"] and (what := unknown(str(path[-1]))):
        return f"{field}: {what}"
    if kind == "missing":
        keys = _required(_type_at(fault["loc"], given))
        hint = f"; give {' and '.join(f'{field}.{key}' for key in keys)}" if keys else ""
        return f"{field}: missing, it has no default{hint}"
    return f"{field}: expected {_expected(fault)}, got {quoted(value)}"


def _expected(fault: Any) -> str:
    """Return in our words what one of pydantic's errors asks for."""
    match fault["type"]:
        case "model_type" | "dict_type":
            said = "a table"
        case "tuple_type":
            said = "a list"
        case "union_tag_invalid":
            said = any_of(tag.strip("'") for tag in fault["ctx"]["expected_tags"].split("', '"))
        case "too_short":
            least = fault["ctx"]["min_length"]
            said = f"at least {'one' if least == 1 else least}"
        case "too_long":
            said = f"at most {fault['ctx']['max_length']}"
        case "int_type" | "int_from_float" | "int_parsing":
            said = "a whole number" + " of sampling periods" * ("delay" in fault["loc"])
        case "bool_type" | "bool_parsing":
            said = "true or false"
        case "less_than_equal" | "greater_than_equal" if _is_probability(fault["loc"]):
            said = "a probability, from 0 to 1"
        case _:
            said = fault["msg"].removeprefix("Value error, ").removeprefix("Input should be ")
    return said


def _is_probability(path: Sequence[int | str]) -> bool:
    places = {("faults", "loss"), ("faults", "duplicate"), ("network", "rewire")}
    return (path[0], path[-1]) in places


def _dotted(path: Sequence[int | str]) -> str:
    """Return `robots[2].initial.q` of ("robots", 2, "initial", "q")."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{shortened(part)}" for part in path)
    return "".join(parts).removeprefix(".")


def _keys_at(path: Sequence[int | str], given: Tables) -> list[str]:
    """Return the keys that the table at a path may have, in the scenario that is given."""
    fields = next(_tables(_type_at(path, given))).model_fields
    return [field.alias or name for name, field in fields.items()]


def _tables_with(name: str, given: Tables) -> list[str]:
    """Return the tables of a scenario in which there may be a key of this name, lists left out."""
    return [
        table
        for table, field in Scenario.model_fields.items()
        if get_origin(field.annotation) is not tuple and name in _keys_at([table], given)
    ]


def _type_at(path: Sequence[int | str], given: Tables) -> Any:
    """Return the type of what stands at a path."""
    annotation: Any = Scenario
    value: Any = given
    for part in path:
        if part in FORMS:
            annotation = TARGETS.get(part, annotation)
            continue
        try:
            value = value[part]
        except (LookupError, TypeError):  # it is missing, or it is a number where a table should be
            value = None
        if isinstance(part, str) and get_origin(annotation) is not dict:
            fields = next(_tables(annotation)).model_fields
            names = {field.alias or name: name for name, field in fields.items()}
            annotation = fields[names.get(part, part)].annotation
            if AlgorithmTable in _tables(annotation):
                annotation = table_for(value)
    return annotation


def _required(annotation: Any) -> list[str]:
    """Return the keys that a table must have, the first of its forms where it has several."""
    table = next(_tables(annotation), None)
    if table is Run:
        return ["duration", "sampling_period"]  # for either of which sampling_times may stand
    if table is Controller:
        return ["kp", "kd"]  # for which frequency may stand
    fields = table.model_fields.items() if table else ()
    return [field.alias or name for name, field in fields if field.is_required()]


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables within a type such as `tuple[Robot, ...]` or `Plant | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _tables(part)
