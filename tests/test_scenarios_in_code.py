"""Scenarios of tests are tables with changed keys, made by tests/scenarios.py, not changed lines.

A line of a scenario's file may be worded and spaced anew at any time; its keys are what is meant.
"""

import ast
import re
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
TABLE = re.compile(r"^\[(run|algorithm|controller|network|target|plant)\]$", re.MULTILINE)


SCENARIO = frozenset({"SCENARIOS", "PAPER_FILE"})
"""What tests call the folder of scenarios, and the file of the paper's example."""


def is_scenario_text(node: ast.AST, known: frozenset[str]) -> bool:
    """Say whether an expression is made of a scenario's text or path, as names known are."""
    match node:
        case ast.Constant(value=str() | bytes() as value):
            text = value if isinstance(value, str) else value.decode("latin-1")
            return bool(TABLE.search(text)) or text.endswith(".toml")
        case ast.Name(id=name):
            return name in known
        case ast.Attribute(value=value, attr=attr):
            return attr == "text" or is_scenario_text(value, known)
        case ast.Call(func=ast.Name(id="toml") | ast.Attribute(attr="to_toml")):
            return True
        case ast.Call(func=function):  # what a call makes of its arguments is no text of theirs
            return isinstance(function, ast.Attribute) and is_scenario_text(function.value, known)
    return any(is_scenario_text(child, known) for child in ast.iter_child_nodes(node))


def changes_of_text(node: ast.AST, known: frozenset[str]) -> set[int]:
    """Return the lines in which a scenario's text is changed by `.replace` or `re.sub`."""
    if isinstance(node, ast.Module | ast.FunctionDef | ast.Lambda):
        arguments = [] if isinstance(node, ast.Module) else node.args.args
        known -= {argument.arg for argument in arguments}
        for each in ast.walk(node):
            if isinstance(each, ast.Assign) and is_scenario_text(each.value, known):
                within = (name for target in each.targets for name in ast.walk(target))
                known |= {name.id for name in within if isinstance(name, ast.Name)}
    found = set[int]().union(*(changes_of_text(n, known) for n in ast.iter_child_nodes(node)))
    match node:
        case ast.Call(func=ast.Attribute(value=text, attr="replace")):
            found |= {node.lineno} if is_scenario_text(text, known) else set()
        case ast.Call(func=ast.Attribute(value=ast.Name(id="re"), attr="sub"), args=[*_, text]):
            found |= {node.lineno} if is_scenario_text(text, known) else set()
    return found


def whole_texts(tree: ast.Module) -> list[int]:
    """Return the lines of constants that are all of a scenario, as text."""
    constants = [n for n in ast.walk(tree) if isinstance(n, ast.Constant)]
    return [
        node.lineno
        for node in constants
        if isinstance(node.value, str) and len(set(TABLE.findall(node.value))) > 3
    ]


@pytest.mark.parametrize(
    ("program", "lines"),
    [
        (
            "text = PAPER_FILE.read_text('utf-8')\nnew = text.replace('alpha = 0.9', 'alpha = 1')",
            [2],
        ),
        ("(SCENARIOS / 'switching.toml').read_text().replace(*SHORT)", [1]),
        (
            "def f():\n    data = (folder / 's.toml').read_bytes()\n    data.replace(b'1', b'2')",
            [3],
        ),
        ("PAPER = SCENARIOS / 'a'\ndef f():\n    return PAPER.read_text().replace('1', '2')", [3]),
        ("experiment.text.replace('seed = 1', 'seed = 2')", [1]),
        ("re.sub('seed = .*', 'seed = 2', toml(SHORT))", [1]),
        ("SMALL = '[run]\\nseed = 1\\n'\nSMALL.replace('1', '2')", [2]),
        ("Scenario.load(PAPER_FILE).replace({'run.seed': 2})\ndone.stderr.replace('x', '')", []),
    ],
)
def test_a_change_of_a_scenario_as_text_is_found(program, lines):
    assert changes_of_text(ast.parse(program), SCENARIO) == set(lines)


@pytest.mark.parametrize(
    "path",
    sorted(TESTS.rglob("*.py")),
    ids=lambda path: path.relative_to(TESTS).as_posix(),
)
def test_scenarios_of_tests_are_built_in_code(path):
    """By tests/scenarios.py: a changed key, not a changed line."""
    tree = ast.parse(path.read_bytes())
    assert changes_of_text(tree, SCENARIO) == set(), (
        "lines that change a scenario's text; see tests/scenarios"
    )
    assert whole_texts(tree) == [], "lines that hold all of a scenario; see tests/scenarios.py"
