"""Writes docs/scenario.md from the scenario's schema and docs/cli.md from the command line.

    python -m docs.reference FOLDER

What they say is said once, in the code; a test holds the two files to it.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

from typer.core import TyperArgument, TyperGroup
from typer.main import get_command

from nrs_cosim.estimator_agents.installed import algorithm_names, bundled_algorithms
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema

_UNITS = ("rad, rad/s", "rad/s", "rad", "N m/rad", "N m s/rad", "s of wall time", "s", "ticks")
_UNIT = re.compile(rf"({'|'.join(map(re.escape, _UNITS))})[;:] ")
_TABLES = {
    "Run": "[run]",
    **{f"Algorithm_{name}": f'[algorithm] name = "{name}"' for name in bundled_algorithms()},
    "Controller": "[controller]",
    "Network": "[network]",
    "Digraph": "[network.position], [network.velocity]",
    "Generator": "[network.generator]",
    "PhaseTable": "[[network.switching]]",
    "HarmonicTarget": '[target] kind = "harmonic"',
    "SampledTarget": '[target] kind = "sampled"',
    "FmuTarget": '[target] kind = "fmu"',
    "Plant": "[plant]",
    "Disturbance": "[disturbance]",
    "Initial": "[initial]",
    "Robot": "[[robots]]",
    "OwnPlant": "[robots.plant]",
    "OwnController": "[robots.controller]",
    "RobotInitial": "[robots.initial]",
    "Faults": "[faults]",
    "FaultyLink": "[[faults.links]]",
    "FaultyRobot": "[[faults.robots]]",
    "ByzantineRobot": "[[faults.byzantine]]",
    "BusTable": "[bus]",
    "TlsTable": "[bus.tls]",
    "Axis": "An axis",
    "Wave": "A wave",
    "Uniform": "A draw",
    "WholeUniform": "A draw of whole numbers",
    "Pattern": "A pattern",
}
"""Of each table of the schema its heading, in the order of the page."""


def scenario_reference() -> str:
    """Return docs/scenario.md."""
    schema = json_schema()
    tables: Mapping[str, Any] = schema["$defs"]
    others = {f"Algorithm_{name}" for name in {*algorithm_names()} - {*bundled_algorithms()}}
    assert tables.keys() - others == _TABLES.keys()
    parts = [
        "# The keys of a scenario",
        "Written by `make reference` from the schema that `nrs schema` prints. n is the number of "
        "robots, m that of each robot's joints. A key without a default must be given where its "
        "table is; `[[a.b]]` is a list of tables.",
        _keys(schema),
    ]
    for name, heading in _TABLES.items():
        words = " ".join(tables[name].get("description", "").split())
        parts += [f"## {heading}", words, _keys(tables[name])]
    return "\n\n".join(parts) + "\n"


def _keys(table: Mapping[str, Any]) -> str:
    """Return the keys of a table: name, form, unit, default and meaning."""
    rows = ["| key | form | unit | default | meaning |", "|---|---|---|---|---|"]
    for name, key in table["properties"].items():
        meaning = key["description"]
        unit = _UNIT.match(meaning)
        cells = [
            f"`{name}`",
            " or ".join(dict.fromkeys(_forms(key, name))),
            unit[1] if unit else key.get("unit", ""),
            _default(key) if name not in table.get("required", ()) else "",
            meaning[unit.end() :] if unit else meaning,
        ]
        rows.append(f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |")
    return "\n".join(rows)


def _forms(key: Mapping[str, Any], name: str = "") -> Iterator[str]:
    """Yield in which forms the value of a key of a name can be written."""
    if "$ref" in key:
        heading = _TABLES.get(key["$ref"].rpartition("/")[2])
        if heading is None:  # of an algorithm that is installed and not of here
            return
        tables = [table.partition(" ")[0] for table in heading.split(", ")]
        table = next((table for table in tables if table.endswith(f".{name}]")), tables[0])
        yield f"`{table}`" if table.startswith("[") else heading[0].lower() + heading[1:]
    for form in (*key.get("anyOf", ()), *key.get("oneOf", ())):
        yield from _forms(form, name)
    if "enum" in key or "const" in key:
        yield " or ".join(f'`"{word}"`' for word in key.get("enum", [key.get("const")]))
    elif key.get("type") == "array":
        if "prefixItems" in key:
            yield f"[{', '.join(' or '.join(_forms(item)) for item in key['prefixItems'])}]"
            return
        many = " or ".join(dict.fromkeys(_forms(key.get("items", {})))) or "value"
        yield many if many.startswith("`[[") else f"list of {_plural(many)}"
    elif key.get("type") in _WORDS:
        yield _WORDS[key["type"]] + _range(key)


def _range(key: Mapping[str, Any]) -> str:
    if "minimum" in key and "maximum" in key:
        least, most = key["minimum"], key["maximum"]
        return f" {least:g} to {most:g}" if least < most else f" {least:g}"
    return ",".join(f" {sign} {key[name]:g}" for name, sign in _BOUNDS.items() if name in key)


def _plural(form: str) -> str:
    if form.startswith("["):
        return form
    return (
        re.sub(r"\b(number|text|list|axis|wave)\b", _more, form)
        .replace("an axes", "axes")
        .replace("a waves", "waves")
    )


def _more(word: re.Match[str]) -> str:
    return "axes" if word[1] == "axis" else f"{word[1]}s"


_WORDS = {
    "number": "number",
    "integer": "whole number",
    "string": "text",
    "boolean": "`true` or `false`",
    "object": "table",
}


_BOUNDS = {
    "exclusiveMinimum": ">",
    "minimum": ">=",
    "exclusiveMaximum": "<",
    "maximum": "<=",
}


def _default(key: Mapping[str, Any]) -> str:
    value = key.get("default")
    return "" if value in (None, [], {}) or isinstance(value, dict) else f"`{json.dumps(value)}`"


def command_reference() -> str:
    """Return docs/cli.md."""
    parts = [
        "# The command line",
        "Written by `make reference` from the commands themselves. Exit status: 0 done; 1 the run "
        "failed, or a check or comparison does not hold; 2 the input is bad; 130 interrupted. "
        "In a pipe, long work says in lines on the error output what it is at; NRS_PROGRESS=off "
        "keeps it silent.",
    ]
    for path, command in _commands("nrs", get_command(app)):
        parts += [f"## `{path}`", " ".join((command.help or "").split())]
        rows = [_option(one) for one in command.params if one.name != "help"]
        if rows:
            parts.append("\n".join(["| option | value | default | |", "|---|---|---|---|", *rows]))
    return "\n\n".join(parts) + "\n"


def _commands(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    """Yield all commands below one, with their paths."""
    if not isinstance(command, TyperGroup):
        yield path, command
        return
    for name, one in command.commands.items():
        yield from _commands(f"{path} {name}", one)


def _option(one: Any) -> str:
    meaning = " ".join((one.help or "").split())
    if isinstance(one, TyperArgument):
        shown = "required" if one.required else ""
        return f"| `{one.metavar or one.name.upper()}` | | {shown} | {meaning} |"
    names = ", ".join(f"`{name}`" for name in sorted((*one.opts, *one.secondary_opts), key=len))
    choices = [f"`{choice}`" for choice in get_args(one.type_descriptor.annotation)]
    value = "" if one.is_flag else one.metavar or " or ".join(choices)
    default = one.show_default if isinstance(one.show_default, str) else one.default
    shown = "" if one.is_flag or not default else f"`{default}`"
    shown = "required" if one.required else shown
    return f"| {names} | {value.replace('|', chr(92) + '|')} | {shown} | {meaning} |"


PAGES = {"scenario.md": scenario_reference, "cli.md": command_reference}

if __name__ == "__main__":
    for name, write in PAGES.items():
        (Path(sys.argv[1]) / name).write_text(write(), "utf-8")
