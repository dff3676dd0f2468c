"""The house stands as it is described: types, format, direction of imports, and the README."""

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent


@pytest.mark.parametrize(
    "command",
    ["ruff check .", "ruff format --check .", "mypy", "lint-imports"],
)
def test_tools_have_no_complaint(command):
    program, *arguments = shlex.split(command)
    done = subprocess.run(
        [BIN / program, *arguments], cwd=ROOT, check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("module", "unneeded"),
    [
        ("nrs_cosim.orchestrator.commands.cli", {"fmpy", "numpy", "pydantic", "scipy", "zenoh"}),
        (
            "nrs_cosim.orchestrator.promises.judging",
            {"fmpy", "scipy.interpolate", "scipy.optimize", "zenoh"},
        ),
        ("nrs_cosim.orchestrator.runs.summary", {"fmpy", "scipy", "tomlkit", "zenoh"}),
        (
            "nrs_cosim.orchestrator.cluster.worker_main",
            {"mcap", "rich", "scipy", "tomlkit", "typer"},
        ),
    ],
)
def test_a_process_starts_without_what_it_need_not_wait_for(module, unneeded):
    program = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert not unneeded & set(done.stdout.split())


def volatile(line: str) -> str:
    """Mask what a machine decides: times, speeds, digests; and trailing blanks."""
    line = re.sub(r"in [\d.]+ s, [\d.e+]+ x real time", "in … s", line.rstrip())
    line = re.sub(r"\d+ %", "… %", line)
    return re.sub(r"\b[0-9a-f]{64}\b", "<digest>", line)


def test_the_session_in_the_readme_is_true(tmp_path):
    (session,) = re.findall(
        r"```console\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL
    )
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    commands = re.split(r"^\$ ", session, flags=re.MULTILINE)[1:]
    assert len(commands) >= 4
    for block in commands:
        command, *expected = block.splitlines()
        program, *arguments = shlex.split(command)
        done = subprocess.run(
            [BIN / program, *arguments], cwd=tmp_path, check=False, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        printed = done.stdout.splitlines()
        assert [volatile(line) for line in printed] == [volatile(line) for line in expected]


def test_the_python_in_the_readme_is_true(tmp_path):
    (program,) = re.findall(
        r"```python\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL
    )
    scenario = ROOT / "scenarios/paper_first_order.toml"
    for command in (
        [BIN / "nrs", "run", scenario, "-o", "recordings/data/first.mcap"],
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(ROOT)!r})\n{program}"],
    ):
        done = subprocess.run(command, cwd=tmp_path, check=False, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["completed (1002, 2)", "True"]


def test_every_dependency_earns_its_line_in_contributing():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = [name for group in project["optional-dependencies"].values() for name in group]
    told = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    for requirement in project["dependencies"] + extras:
        assert re.split("[<>=]", requirement)[0] in told


def test_constraints_pin_every_dependency_and_name_no_place():
    pins = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    assert all(re.fullmatch(r"[\w.-]+==[\w.+]+", pin) for pin in pins)
    pinned = {re.sub("[-_.]+", "-", pin.split("==")[0]).lower() for pin in pins}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = [name for group in project["optional-dependencies"].values() for name in group]
    for requirement in project["dependencies"] + extras:
        assert re.split("[<>=]", requirement)[0].lower() in pinned


WAITS = {"deadline", "timeout", "wait"}
"""Arguments by which something waits, s; and methods whose first argument is one."""
WAITERS = {"communicate", "exception", "join", "result", "wait"}
CLOCKS = {"monotonic", "perf_counter", "sleep"}
OWN_TIME = {"mutation/trying.py", "network/relay.py"}
"""A tool that ends what does not, and a wire that is slow on purpose."""


def literal(node: ast.expr) -> bool:
    """Return whether it is a time of its own; 0 is none."""
    return isinstance(node, ast.Constant) and type(node.value) in {int, float} and node.value != 0


@pytest.mark.parametrize(
    "path",
    sorted((ROOT / "tests").rglob("*.py")),
    ids=lambda path: path.relative_to(ROOT / "tests").as_posix(),
)
def test_how_long_a_test_waits_is_one_of_the_times_in_guard(path):
    """No test sleeps, or holds a machine's speed against a number of its own."""
    if path.relative_to(ROOT / "tests").as_posix() in OWN_TIME:
        return
    found = []
    for node in ast.walk(ast.parse(path.read_bytes())):
        match node:
            case ast.Call(func=ast.Attribute(attr=name), args=[first]) if name in WAITERS:
                found += [node.lineno] if literal(first) else []
            case ast.keyword(arg=name, value=value) if name in WAITS and literal(value):
                found.append(node.value.lineno)
            case ast.ImportFrom(module="time", names=names):
                found += [node.lineno for name in names if name.name in CLOCKS]
            case ast.Attribute(value=ast.Name(id="time"), attr=name) if name in CLOCKS:
                found.append(node.lineno)
    assert found == [], "lines that wait for a time of their own; see tests/guard.py"
