"""A scenario file is read once; every error names the field, the value and what was expected."""

import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, get_args, get_origin

from pydantic import BaseModel, ValidationError

from bus.errors import InputError
from bus.network.access import expect_host_name
from bus.text import storable
from estimator_agents.algorithm import algorithm_names, policies_of, why_one_digraph
from orchestrator.errors import ScenarioError
from orchestrator.scenario.faults import wrong_faults
from orchestrator.scenario.graphs import with_edges
from orchestrator.scenario.inlining import inline_target
from orchestrator.scenario.moving import with_motion
from orchestrator.scenario.networks import hetero_at, topologies_of
from orchestrator.scenario.numbers import parse_robots
from orchestrator.scenario.tables.faults import Faults
from orchestrator.scenario.tables.fmus import Plant
from orchestrator.scenario.tables.scenario import Disturbance, Scenario, TlsTable
from orchestrator.scenario.tables.targets import TARGETS
from orchestrator.scenario.tables.values import FORMS, Uniform
from orchestrator.scenario.targets import unsampled_times, wrong_target
from orchestrator.scenario.times import wrong_times
from orchestrator.scenario.wrong_networks import unused_turns, wrong_form, wrong_network
from plant_fmu.archives.quantities import MOTION, UNITS
from recordings.container import MAGIC

SHORTEST = 1e-6
AXES = "numbers, one for each of the target's axes"
ELSEWHERE = {
    "kp": "controller.kp",
    "kd": "controller.kd",
    "q": "initial.q",
    "qd": "initial.qd",
    "position_ref": "initial.position",
    "velocity_ref": "initial.velocity",
    **{
        f"disturbance_{part}": "disturbance.axes"
        for part in ("offset", "rate", "amplitude", "frequency", "phase")
    },
}
"""Parameters of a plant that a scenario gives in tables of their own."""


@dataclass(frozen=True, slots=True)
class ScenarioFile:
    """A scenario, the text it was read from, and the folder that its paths are relative to."""

    scenario: Scenario
    text: str
    name: str
    folder: Path


def read_scenario(path: Path) -> ScenarioFile:
    """Read a scenario file; `ScenarioError` when it is missing, malformed or wrong.

    What it names for its target's samples or its network's edges is read too, and takes the name's
    place in the text; an FMU that is its target is run, and its samples stand there too.
    """
    try:
        text = _text_of(path)
    except FileNotFoundError:
        raise ScenarioError(f"{path}: no such file") from None
    except UnicodeDecodeError:
        raise ScenarioError(f"{path}: cannot be read: it is no text in UTF-8") from None
    except OSError as error:
        raise ScenarioError(f"{path}: cannot be read: {error.strerror}") from None
    text = inline_target(text, path.parent, str(path))
    text = with_edges(text, path.parent, str(path))
    text = with_motion(text, path.parent, str(path))
    return parse_scenario(text, storable(path.stem), path.parent, str(path))


def _text_of(path: Path) -> str:
    """Return a file's text; a byte order mark is passed over."""
    data = path.read_bytes()
    if data.startswith(MAGIC):
        raise ScenarioError(f"{path}: is a recording (MCAP), not a scenario; `nrs info` reads it")
    return data.decode("utf-8-sig").replace("\r\n", "\n")


def parse_scenario(text: str, name: str, folder: Path, origin: str) -> ScenarioFile:
    """Parse a scenario's text; errors begin with its origin."""
    try:
        tables = tomllib.loads(text)
        if not tables:
            raise ScenarioError(f"{origin}: is empty; a scenario has {', '.join(_needed())}")
        scenario = Scenario.model_validate(tables)
    except tomllib.TOMLDecodeError as error:
        raise ScenarioError(f"{origin}: not valid TOML: {error}") from None
    except RecursionError:
        raise ScenarioError(f"{origin}: not valid TOML: nested too deeply") from None
    except ValidationError as error:
        faults = [_describe(fault) for fault in _told_once(error.errors())]
        raise ScenarioError("\n".join(f"{origin}: {fault}" for fault in faults)) from None
    except ValueError as error:  # a number of more digits than Python reads
        raise ScenarioError(f"{origin}: not valid TOML: {error}") from None
    faults = list(wrong_target(scenario)) or list(_faults(scenario))
    if faults:
        raise ScenarioError("\n".join(f"{origin}: {fault}" for fault in faults))
    return ScenarioFile(scenario, text, name, folder)


def _needed() -> list[str]:
    """Return the tables without which there is no scenario."""
    return [f"[{name}]" for name, field in Scenario.model_fields.items() if field.is_required()]


def _told_once(faults: Sequence[Any]) -> Iterator[Any]:
    """Yield pydantic's errors without those keys that are missing because they are misspelt."""
    meant: set[tuple[int | str, ...]] = set()
    for fault in faults:
        if fault["type"] == "extra_forbidden":
            *table, name = fault["loc"]
            meant |= {(*table, key) for key in _close(str(name), _keys_at(table))}
    for fault in faults:
        if fault["type"] != "missing" or fault["loc"] not in meant:
            yield fault


def _describe(fault: Any) -> str:
    """Turn one of pydantic's errors into `field: expected …, got …`."""
    path = [part for part in fault["loc"] if part not in FORMS]
    field, value, kind = _dotted(path), fault["input"], fault["type"]
    if kind == "extra_forbidden":
        return f"{field}: unknown key{_nearest(str(path[-1]), _keys_at(fault['loc'][:-1]))}"
    if kind == "missing":
        keys = _required(_type_at(fault["loc"]))
        hint = f"; give {' and '.join(f'{field}.{key}' for key in keys)}" if keys else ""
        return f"{field}: missing, it has no default{hint}"
    return f"{field}: expected {_expected(fault)}, got {value!r}"


def _expected(fault: Any) -> str:
    """Return in our words what one of pydantic's errors asks for."""
    match fault["type"]:
        case "model_type":
            return "a table"
        case "tuple_type":
            return "a list"
        case "union_tag_invalid":
            return _forms(fault)
        case "too_short":
            least = fault["ctx"]["min_length"]
            return f"at least {'one' if least == 1 else least}"
        case "too_long":
            return f"at most {fault['ctx']['max_length']}"
    said: str = fault["msg"].removeprefix("Value error, ")
    return said.removeprefix("Input should be ")


def _forms(fault: Any) -> str:
    """Name the forms that a value may have."""
    *most, last = (tag.strip("'") for tag in fault["ctx"]["expected_tags"].split("', '"))
    return f"{', '.join(most)} or {last}" if most else last


def _dotted(path: Sequence[int | str]) -> str:
    """Return `robots[2].initial.q` of ("robots", 2, "initial", "q")."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in path)
    return "".join(parts).removeprefix(".")


def _keys_at(path: Sequence[int | str]) -> list[str]:
    """Return the keys that the table at a path may have."""
    fields = next(_tables(_type_at(path))).model_fields
    return [field.alias or name for name, field in fields.items()]


def _type_at(path: Sequence[int | str]) -> Any:
    """Return the type of what stands at a path."""
    annotation: Any = Scenario
    for part in path:
        if part in FORMS:
            annotation = TARGETS.get(part, annotation)
        elif isinstance(part, str) and get_origin(annotation) is not dict:
            fields = next(_tables(annotation)).model_fields
            names = {field.alias or name: name for name, field in fields.items()}
            annotation = fields[names.get(part, part)].annotation
    return annotation


def _required(annotation: Any) -> list[str]:
    """Return the keys that a table must have, the first of its forms where it has several."""
    table = next(_tables(annotation), None)
    fields = table.model_fields.items() if table else ()
    return [field.alias or name for name, field in fields if field.is_required()]


def _tables(annotation: Any) -> Iterator[type[BaseModel]]:
    """Yield the tables within a type such as `tuple[Robot, ...]` or `Plant | None`."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for part in get_args(annotation):
        yield from _tables(part)


def _nearest(name: str, known: Sequence[str]) -> str:
    """Suggest the nearest known name, or list them all."""
    close = _close(name, known)
    return f"; did you mean {close[0]!r}?" if close else f"; there are {', '.join(known)}"


def _close(name: str, known: Sequence[str]) -> list[str]:
    """Return the nearest known name, if one is near."""
    return get_close_matches(name, known, n=1)


def _faults(scenario: Scenario) -> Iterator[str]:
    """Yield what is wrong in shape or in the relation of one field to another."""
    no_form = wrong_form(scenario.network)
    if no_form:
        yield no_form
        return
    n, m = scenario.n, scenario.m
    network_faults = list(wrong_network(scenario))
    yield from _algorithm_faults(scenario)
    time_faults = list(wrong_times(scenario.run))
    yield from time_faults or unsampled_times(scenario)
    yield from _plant_faults("plant", scenario.plant)
    yield from network_faults
    if not (time_faults or network_faults):
        yield from unused_turns(scenario)
    yield from _gain_faults("controller", scenario.controller, m)
    yield from _axes_faults("disturbance", scenario.disturbance, m)
    for name, value in scenario.initial:
        yield from _draw_faults(f"initial.{name}", value)
        yield from _initial_faults(f"initial.{name}", value, n, m)
    if scenario.faults != Faults():
        yield from wrong_faults(scenario, None if network_faults else topologies_of(scenario).links)
    yield from _robot_faults(scenario)
    yield from _hosts_faults(scenario.bus.tls, n)


def _robot_faults(scenario: Scenario) -> Iterator[str]:
    n, m = scenario.n, scenario.m
    seen: set[int] = set()
    for i, robot in enumerate(scenario.robots):
        here = f"robots[{i}]"
        if robot.id > n:
            yield f"{here}.id: expected 1 to {n}, got {robot.id}"
        if robot.id in seen:
            yield f"{here}.id: robot {robot.id} has been given before"
        seen.add(robot.id)
        if robot.plant:
            yield from _plant_faults(f"{here}.plant", robot.plant)
        if robot.controller:
            yield from _gain_faults(f"{here}.controller", robot.controller, m)
        if robot.disturbance:
            yield from _axes_faults(f"{here}.disturbance", robot.disturbance, m)
        for name, value in robot.initial:
            yield from _draw_faults(f"{here}.initial.{name}", value)
            if isinstance(value, tuple):
                yield from _length_fault(f"{here}.initial.{name}", value, m, AXES)


def _hosts_faults(tls: TlsTable | None, n: int) -> Iterator[str]:
    """Yield what is wrong with the hosts' names and robots; a robot has one host."""
    taken: dict[int, str] = {}
    for host, text in (tls.hosts if tls else {}).items():
        here = f"bus.tls.hosts.{host}"
        try:
            expect_host_name(host, "bus.tls.hosts")
            robots = parse_robots(text, here, n)
        except InputError as error:
            yield str(error)
            continue
        for robot in robots:
            if robot in taken:
                yield f"{here}: robot {robot} is already {taken[robot]!r}'s"
                break
            taken[robot] = host


def _algorithm_faults(scenario: Scenario) -> Iterator[str]:
    if scenario.algorithm.name not in algorithm_names():
        yield (
            f"algorithm.name: expected one of {', '.join(algorithm_names())}, "
            f"got {scenario.algorithm.name!r}"
        )
        return
    apart, why = hetero_at(scenario.network), why_one_digraph(scenario.algorithm.name)
    if apart and why:
        yield (
            f"{apart}.velocity: {scenario.algorithm.name} cannot hear positions and velocities "
            f"over different digraphs: {why}; give {apart} one digraph, or take dcea1"
        )
    known = policies_of(scenario.algorithm.name)
    if scenario.algorithm.missing and scenario.algorithm.missing not in known:
        yield (
            f"algorithm.missing: expected one of {', '.join(known)}, which "
            f"{scenario.algorithm.name} knows, got {scenario.algorithm.missing!r}"
        )


def _plant_faults(where: str, plant: Plant) -> Iterator[str]:
    ours = [name for name in UNITS if name not in MOTION]
    for name in plant.variables:
        if name not in ours:
            yield f"{where}.variables.{name}: no quantity of ours{_nearest(name, ours)}"
    for name in ("step", "control_step"):
        given = getattr(plant, name)
        if given is not None and given < SHORTEST:
            yield f"{where}.{name}: expected at least {SHORTEST:g} s, got {given:g} s"
    for name in plant.parameters:
        if name in ELSEWHERE:
            yield f"{where}.parameters.{name}: give it as {ELSEWHERE[name]} instead"


def _gain_faults(where: str, controller: Any, m: int) -> Iterator[str]:
    for name, value in controller:
        if isinstance(value, tuple):
            yield from _length_fault(
                f"{where}.{name}", value, m, "entries, one for each of the target's axes"
            )
            for i, row in enumerate(value):
                if isinstance(row, tuple):
                    yield from _length_fault(f"{where}.{name}[{i}]", row, m, AXES)


def _axes_faults(where: str, disturbance: Disturbance, m: int) -> Iterator[str]:
    if disturbance.axes:
        yield from _length_fault(
            f"{where}.axes", disturbance.axes, m, "axes, one for each of the target's axes"
        )


def _draw_faults(where: str, value: Any) -> Iterator[str]:
    if isinstance(value, Uniform) and value.uniform[0] > value.uniform[1]:
        yield f"{where}.uniform: expected [low, high] with low <= high, got {list(value.uniform)}"


def _initial_faults(where: str, value: Any, n: int, m: int) -> Iterator[str]:
    """Yield what is wrong with the shape of what all robots start with."""
    if not isinstance(value, tuple):
        return
    rows = [row for row in value if isinstance(row, tuple)]
    shape = f"expected {m} numbers for each robot, or {n} x {m}, a row for each"
    if not rows and len(value) != m:
        yield f"{where}: {shape}, got {len(value)} numbers"
    elif rows and len(rows) != n:
        yield f"{where}: {shape}, got {len(rows)} rows"
    for i, row in enumerate(rows):
        yield from _length_fault(f"{where}[{i}]", row, m, AXES)


def _length_fault(where: str, value: Sequence[Any], length: int, of: str) -> Iterator[str]:
    if len(value) != length:
        yield f"{where}: expected {length} {of}, got {len(value)}"
