"""Changes of a scenario: `key=value,key=value`, the keys those of its file, the values TOML.

    plant.parameters.m1=2.0,controller.kp=[10, 20]
    robots=1-3,7,plant.variables={q={pattern="theta{i}"},qd=["w1","w2"]}
    faults.links.0.loss=0.2

A change sets the keys that it names and keeps the others, so a table in braces is the same as its
keys with dots, and takes the place of what is none; a number in a key is a place in a list, from 0
on. A value that is no TOML is a text, as `plant.fmu=other.fmu`. A comma ends a value where what
stands before it is TOML, or can be none. `robots` confines a change to some robots: it goes into
their own tables. What a value excludes goes: another FMU is another plant, of whose old table
nothing is kept, and so it is with another kind of target and another form of network. Another
algorithm keeps the parameters that it has as well.
"""

import re
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import tomlkit
from tomlkit.exceptions import TOMLKitError
from tomlkit.items import Array, InlineTable

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted, shortened, storable
from nrs_cosim.estimator_agents.installed import is_installed, parameters_of
from nrs_cosim.orchestrator.scenario.assets import Assets
from nrs_cosim.orchestrator.scenario.comments import drop_comments
from nrs_cosim.orchestrator.scenario.resolution import TARGET_FMU
from nrs_cosim.orchestrator.scenario.robot_ids import parse_robots

_WORD = r"""(?:[\w-]+|"[^"]*"|'[^']*')"""
_NEXT = re.compile(rf",(?=\s*{_WORD}(?:\s*\.\s*{_WORD})*\s*=)")
_OF_PLANTS = ("plant", "controller", "disturbance")
_NETWORKS = {"adjacency", "generator", "edge_list", "edges", "graphml", "position", "switching"}
_FILES = {("network", "edges"), ("network", "graphml"), ("target", "file")}
_ENDINGS = {"fmu": ".fmu", "parameters": ".ssv"}
"""By which the values of keys are files."""
_TIMES = {
    "sampling_period": ("sampling_times",),
    "sampling_times": ("sampling_period", "sampling_jitter"),
}
"""What cannot stand beside a key of `[run]`."""

Key = tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Change:
    """Some keys of a scenario that get other values."""

    option: str
    """Where it was given."""
    text: str
    robots: tuple[int, ...] | None
    """Whose they are; None for all."""
    values: Mapping[Key, Any]

    @classmethod
    def of(cls, option: str, text: str) -> "Change":
        """Read `key=value,key=value`; `InputError` names the option and the part that is wrong."""
        robots: tuple[int, ...] | None = None
        values: dict[Key, Any] = {}
        for part in _parts(text):
            name, equals, given = part.partition("=")
            if not equals or not name.strip():
                where = "" if part == text else f" in {quoted(text)}"
                raise InputError(f"{option}: expected key=value, got {quoted(part)}{where}")
            if name.strip() == "robots":
                if robots is not None:
                    raise InputError(f"{option}: robots: is given twice in {quoted(text)}")
                robots = parse_robots(given.strip(), f"{option} robots")
                continue
            for key, value in _leaves(_table(option, name, given, part)):
                if any(key[: len(old)] == old or old[: len(key)] == key for old in values):
                    raise InputError(
                        f"{option}: {shortened('.'.join(key))}: is given twice in {quoted(text)}"
                    )
                values[key] = _found(key, value)
        if not values:
            raise InputError(f"{option}: changes nothing: {quoted(text)}")
        return cls(option, text, robots, values)

    def of_plants(self) -> "Change":
        """Return it; `InputError` where it changes what is no part of a robot's plant."""
        for key in self.values:
            if key[0] not in _OF_PLANTS or len(key) == 1:
                raise InputError(
                    f"{self.option}: {'.'.join(key)}: expected a key of plant, controller or "
                    "disturbance, such as controller.kp"
                )
        return self

    def within(self, table: str) -> "Change":
        """Return it as one of the whole scenario, of which it is of a table; its name may lead."""
        return replace(
            self,
            values={
                key if key[0] == table and len(key) > 1 else (table, *key): value
                for key, value in self.values.items()
            },
        )


def with_changes(text: str, changes: Sequence[Change]) -> str:
    """Return a scenario's text with changes; what else is wrong with it is left to its reader."""
    if not changes:
        return text
    try:
        document = tomlkit.parse(text.removeprefix("\ufeff"))
    except (TOMLKitError, ValueError, RecursionError):
        return text
    for change in changes:
        if change.robots is None:
            _apply(document, change.values)
        for robot in change.robots or ():
            _apply(_own(document, robot, change.option), change.values)
    return tomlkit.dumps(document)


def tables_with(tables: Mapping[str, Any], values: Mapping[Key, Any]) -> dict[str, Any]:
    """Return a scenario's tables with other values of all robots; those given stay as they are."""
    changed = deepcopy(dict(tables))
    _apply(changed, values)
    return changed


def unchanged_assets(assets: Assets, change: Change, *, keep_motion: bool = False) -> Assets:
    """Return the assets that a change leaves as they are.

    When a target's FMU is sampled depends on the run: its samples are of the same run and target,
    unless they are to be kept whatever changes.
    """
    keys = [".".join(key) for key in change.values] if change.robots is None else []
    again = not keep_motion and any(key.partition(".")[0] in {"run", "target"} for key in keys)
    return {
        field: asset
        for field, asset in assets.items()
        if not any(field == key or field.startswith((f"{key}.", f"{key}[")) for key in keys)
        and not (again and field == TARGET_FMU)
    }


def _parts(text: str) -> Iterator[str]:
    """Yield each `key=value`: the shortest that is TOML, or up to the next key where none is."""
    start, ends = 0, [*(match.start() for match in _NEXT.finditer(text)), len(text)]
    while ends:
        end = next((end for end in ends if _is_toml(text[start:end])), ends[0])
        yield text[start:end].strip()
        start, ends = end + 1, [later for later in ends if later > end]


def _is_toml(text: str) -> bool:
    try:
        return bool(tomllib.loads(text))
    except (ValueError, RecursionError):
        return False


def _table(option: str, name: str, given: str, part: str) -> Mapping[str, Any]:
    """Return a part as TOML has it, or with its value as a text."""
    if _is_toml(part):
        return tomllib.loads(part)
    if given.lstrip()[:1] in {"[", "{", '"', "'"} or not _is_toml(f"{name} = 0"):
        whole = name.partition("[")[0].strip()
        hint = (
            f"; a list is given whole, as {shortened(whole)}=[…], and a name that has brackets in "
            "quotation marks"
        )
        raise InputError(
            f"{option}: {shortened(name.strip())}: expected a key and a value of TOML, got "
            f"{quoted(part)}{hint if '[' in name and whole else ''}"
        )
    table: dict[str, Any] = tomllib.loads(f"{name} = 0")
    inner = table
    while True:
        ((key, value),) = inner.items()
        if not isinstance(value, dict):
            inner[key] = given.strip()
            return table
        inner = value


def _leaves(table: Mapping[str, Any], above: Key = ()) -> Iterator[tuple[Key, Any]]:
    """Yield the keys of all values that are no tables, or tables with nothing in them."""
    for name, value in table.items():
        if value and isinstance(value, dict):
            yield from _leaves(value, (*above, name))
        else:
            yield (*above, name), value


def _found(key: Key, value: Any) -> Any:
    """Return a value; a file of here is one wherever the scenario lies."""
    if not isinstance(value, str):
        return value
    names_file = key in _FILES or any(
        key[-1] == name and value.endswith(end) for name, end in _ENDINGS.items()
    )
    if not names_file or not Path(value).exists():
        return value
    path = str(Path(value).absolute())
    if storable(path) != path:
        raise InputError(
            f"{'.'.join(key)}: {storable(path)}: its path is no text in UTF-8; rename it"
        )
    return path


def _own(document: tomlkit.TOMLDocument, robot: int, option: str) -> Any:
    """Return the table of what a robot has of its own."""
    entries = document.setdefault("robots", tomlkit.aot())
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise InputError(f"{option}: robots: the scenario's own are no [[robots]]")
    own = next((entry for entry in entries if entry.get("id") == robot), None)
    if own is None:
        own = tomlkit.table()
        own["id"] = robot
        entries.append(own)
        own = entries[-1]
    return own


def _apply(table: Any, values: Mapping[Key, Any]) -> None:
    """Set values in a table of a scenario, or of a robot; None takes a key out."""
    _make_room(table, values)
    for key, value in values.items():
        inner, name = table, key[-1]
        for depth, part in enumerate(key[:-1], 1):
            outer, inner = inner, _within(inner, key, depth)
            if isinstance(inner, InlineTable | Array):  # on the lines of its own key
                drop_comments(outer, part)
        at: Any = _place(inner, key) if isinstance(inner, list) else name
        if not isinstance(inner, list) and inner.get(name) != value:
            drop_comments(inner, name)
        if value is not None:
            inner[at] = value
        elif isinstance(inner, list) or name in inner:
            del inner[at]


def _within(table: Any, key: Key, depth: int) -> Any:
    """Return what is at a key's part before `depth`: where there is none, a table, or a list for 0.

    A name takes the place of a list in which there are no tables: it is another form of it.
    """
    part, below = key[depth - 1 : depth + 1]
    if isinstance(table, list):
        return table[_place(table, key[:depth])]
    if below == "0" and part not in table:
        table[part] = [tomlkit.table() if key[depth + 1 :] else 0]
    was = table.get(part)
    if part == "parameters" and isinstance(was, str):
        raise InputError(f"parameters.{below}: parameters are those of {quoted(str(was))}")
    if isinstance(was, list):
        keeps = below.isdecimal() or any(isinstance(entry, dict) for entry in was)
    else:
        keeps = isinstance(was, dict)
    if not keeps:
        table[part] = tomlkit.inline_table() if isinstance(table, InlineTable) else tomlkit.table()
    return table[part]


def _place(entries: list[Any], key: Key) -> int:
    """Return the place in a list that the end of a key is; `InputError` where there is none."""
    part = key[-1]
    if not (part.isascii() and part.isdecimal() and int(part) < len(entries)):
        raise InputError(
            f"{shortened('.'.join(key))}: expected a place in a list of {len(entries)}, from 0 on"
        )
    return int(part)


def _make_room(table: Any, values: Mapping[Key, Any]) -> None:
    """Take out what cannot stay beside values: another FMU's keys, or another form's."""
    given = {key for key, value in values.items() if value is not None}
    if ("plant", "fmu") in given:
        table["plant"] = tomlkit.table()
    forms = {key[1] for key in given if key[0] == "network" and len(key) > 1} & _NETWORKS
    network = table.get("network")
    if forms and isinstance(network, dict) and not forms & network.keys():
        table["network"] = tomlkit.table()
    kind, target = values.get(("target", "kind")), table.get("target")
    if kind and isinstance(target, dict) and target.get("kind") != kind:
        table["target"] = tomlkit.table()
    _drop_parameters(table.get("algorithm"), values.get(("algorithm", "name")))
    run = table.get("run")
    if isinstance(run, dict):
        for one, others in _TIMES.items():
            if ("run", one) in given:
                for other in others:
                    run.pop(other, None)


def _drop_parameters(algorithm: Any, name: Any) -> None:
    """Take out parameters of an algorithm that the one of another name does not have."""
    was = algorithm.get("name") if isinstance(algorithm, dict) else None
    if not (isinstance(was, str) and is_installed(was) and is_installed(name)):
        return
    old, new = ({one.name for one in parameters_of(of)} for of in (was, name))
    for parameter in old - new:
        algorithm.pop(parameter, None)
