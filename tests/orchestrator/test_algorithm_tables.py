"""The table of an algorithm is made of its class, whatever its parameters are called."""

import sys

import pytest

from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
from tests.scenarios import paper

MODULE = """
from dataclasses import dataclass
from typing import ClassVar, Literal

import nrs_cosim as nrs


@dataclass(frozen=True)
class Named(nrs.Algorithm):
    missing: ClassVar = ("hold",)
    copy: float = 1.0
    json: int = nrs.parameter("how many", 2, least=0, most=9)
    model_config: bool = True
    parameters: Literal["sum", "mean"] = nrs.parameter("how", "mean")
    schema: str = "text"

    def jump(self, estimate, disagreement):
        return estimate
"""
VALUES = {"copy": 1.0, "json": 2, "model_config": True, "parameters": "mean", "schema": "text"}


@pytest.fixture
def install(tmp_path, monkeypatch):
    """Return a function that puts a module there as an installer does."""
    monkeypatch.syspath_prepend(str(tmp_path))

    def put(name, module, kind):
        (tmp_path / f"{name}.py").write_text(module, "utf-8")
        about = tmp_path / f"{name}-1.0.dist-info"
        about.mkdir()
        (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
        (about / "entry_points.txt").write_text(f"[nrs.algorithms]\n{name} = {name}:{kind}\n")
        monkeypatch.delitem(sys.modules, name, raising=False)
        return tmp_path / f"{name}.py"

    return put


def test_parameters_may_have_names_that_pydantic_uses(install):
    install("named", MODULE, "Named")
    chosen = paper({"algorithm": {"name": "named"}}).scenario.algorithm
    assert chosen.parameters == VALUES
    given = {"copy": 3, "json": 9, "model_config": False, "parameters": "sum"}
    experiment = paper({"algorithm": {"name": "named", **given}})
    expected = {**VALUES, **given, "copy": 3.0}
    assert experiment.scenario.algorithm.parameters == expected
    assert experiment.scenario != paper().scenario
    wrong = {"json": 2.5, "parameters": "max", "model_config": 0, "schemma": 1}
    with pytest.raises(ScenarioError) as error:
        paper({"algorithm": {"name": "named", **wrong}})
    assert str(error.value).splitlines() == [
        "paper.toml: algorithm.json: expected a whole number, got 2.5",
        "paper.toml: algorithm.model_config: expected true or false, got 0",
        "paper.toml: algorithm.parameters: expected 'sum' or 'mean', got 'max'",
        "paper.toml: algorithm.schemma: unknown key; did you mean 'schema'?",
    ]


def test_the_schema_has_their_types_bounds_and_choices(install):
    install("named", MODULE, "Named")
    keys = json_schema()["$defs"]["Algorithm_named"]["properties"]
    found = {
        name: {key: value for key, value in keys[name].items() if key != "title"} for name in VALUES
    }
    assert found == {
        "copy": {"type": "number", "default": 1.0},
        "json": {
            "type": "integer",
            "default": 2,
            "minimum": 0,
            "maximum": 9,
            "description": "how many",
        },
        "model_config": {"type": "boolean", "default": True},
        "parameters": {
            "type": "string",
            "default": "mean",
            "enum": ["sum", "mean"],
            "description": "how",
        },
        "schema": {"type": "string", "default": "text"},
    }


@pytest.mark.parametrize(
    ("module", "line"),
    [(MODULE.replace("copy: float", "copy: list"), 11), ("import numpi\n", 1)],
    ids=["declaration", "import"],
)
def test_a_wrong_algorithm_class_affects_no_other_scenario(install, module, line):
    path = install("broken", module, "Named")
    table = json_schema()["$defs"]["Algorithm_broken"]
    assert table["description"].startswith("algorithm.name: broken")
    assert table["description"].endswith(f", at {path}:{line}")
    assert table["additionalProperties"] is True
    assert paper().scenario.algorithm.name == "dcea1"
