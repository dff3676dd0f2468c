"""Scenarios for the tests, built in code: one of the repository's with other values at some keys.

    paper({"run.duration": 1.0, "algorithm.alpha": 0.8})
    write(tmp_path / "s.toml", {"network": {"edge_list": [[0, 1], [1, 2]]}}, base="paper_jitter")

A key is a path through tables, and through lists by place: `network.adjacency.1`. A value of None
takes the key out. What comes of it need not be right: what is wrong with it, the product says.
"""

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomlkit

from nrs_cosim.api.scenario import plain
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.file import parse_scenario

SCENARIOS = Path(__file__).parents[1] / "scenarios"
PAPER = "paper_first_order"
"""The paper's first example."""
PAPER_FILE = SCENARIOS / f"{PAPER}.toml"
SHORT = {"run.duration": 1.0}
SECOND_ORDER = {"algorithm.name": "dcea2", "algorithm.alpha": 1.1, "algorithm.beta": 0.9}

Changes = Mapping[str, Any]


def drawn(low: float, high: float) -> dict[str, Any]:
    """Return the initial state of robots whose numbers are all drawn from a range."""
    return {name: {"uniform": [low, high]} for name in ("position", "velocity", "q", "qd")}


def tables(*changes: Changes, base: str | Mapping[str, Any] = PAPER) -> dict[str, Any]:
    """Return the tables of a scenario of the repository, or those given, with changes."""
    text = SCENARIOS.joinpath(f"{base}.toml").read_text("utf-8") if isinstance(base, str) else ""
    made = tomllib.loads(text) if isinstance(base, str) else plain(base)
    for key, value in (item for change in changes for item in change.items()):
        put(made, key, value)
    return made


def put(made: Any, key: str, value: Any) -> None:
    """Put a value at a key of tables; None takes the key out."""
    *path, name = key.split(".")
    for part in path:
        made = made[int(part)] if isinstance(made, list) else made.setdefault(part, {})
    if isinstance(made, list):
        made[int(name)] = plain(value)
    elif value is None:
        del made[name]
    else:
        made[name] = plain(value)


def toml(*changes: Changes, base: str | Mapping[str, Any] = PAPER) -> str:
    """Return such tables as text."""
    return tomlkit.dumps(tables(*changes, base=base))


def write(path: Path, *changes: Changes, base: str | Mapping[str, Any] = PAPER) -> Path:
    """Write such tables into a file, and return its path."""
    path.write_text(toml(*changes, base=base), "utf-8")
    return path


def example(
    base: str | Mapping[str, Any], *changes: Changes, folder: Path = SCENARIOS, name: str = ""
) -> Experiment:
    """Return the experiment that such tables are; errors are of `<name>.toml`."""
    name = name or (base if isinstance(base, str) else "made")
    return parse_scenario(toml(*changes, base=base), name, folder, f"{name}.toml")


def paper(*changes: Changes, folder: Path = SCENARIOS) -> Experiment:
    """Return the paper's first example with changes; errors are of `paper.toml`."""
    return example(PAPER, *changes, folder=folder, name="paper")
