"""The house stands as it is described: format, direction of imports, and the README."""

import ast
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

import nrs_cosim
from docs import demo, reference

ROOT = Path(__file__).parents[1]
BIN = Path(sys.executable).parent


@pytest.mark.parametrize("command", ["ruff check .", "ruff format --check .", "lint-imports"])
def test_format_lint_and_imports_pass(command):
    program, *arguments = shlex.split(command)
    done = subprocess.run(
        [BIN / program, *arguments], cwd=ROOT, check=False, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.parametrize(
    ("module", "unneeded"),
    [
        ("nrs_cosim.orchestrator.cli.main", {"fmpy", "numpy", "pydantic", "scipy", "zenoh"}),
        (
            "nrs_cosim.orchestrator.analysis.comparison",
            {"fmpy", "scipy", "zenoh"},
        ),
        ("nrs_cosim.orchestrator.cli.terminal_run", {"scipy", "tomlkit"}),
        ("nrs_cosim.orchestrator.engine.summary", {"fmpy", "scipy", "tomlkit", "zenoh"}),
        (
            "nrs_cosim.orchestrator.cluster.worker_main",
            {"mcap", "rich", "scipy", "tomlkit", "typer"},
        ),
    ],
)
def test_a_process_starts_without_unneeded_imports(module, unneeded):
    program = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, check=True, capture_output=True, text=True
    )
    assert not unneeded & set(done.stdout.split())


PAPER = ROOT / "scenarios/paper_first_order.toml"
RUNS = {"multiprocessing", "numpy.ma", "scipy", "tomlkit", "zenoh"}
"""What takes part in runs alone, of few robots at periodic times."""
OTHERS = {"fmpy", "lxml", "attr"}
"""What takes part where FMUs are opened that are not bundled."""
CHECKED = {
    *("google.protobuf", "mcap", "nrs_cosim.plant_fmu.checking"),
    *("nrs_cosim.plant_fmu.drives.law_outside", "nrs_cosim.plant_fmu.isolation"),
    "nrs_cosim.plant_fmu.bundled.model_description",
}
"""What records, tries FMUs, drives and isolates others', and writes what is not in the cache."""


def test_check_and_info_load_nothing_that_they_do_not_use(tmp_path):
    recording = tmp_path / "a.mcap"
    scenario = nrs_cosim.Scenario.load(PAPER).replace({"run.duration": 1.0})
    nrs_cosim.run(scenario, recording).close()
    commands = {
        ("check", PAPER): RUNS | OTHERS | CHECKED,
        ("info", recording): RUNS | OTHERS | {"nrs_cosim.orchestrator.cli.option_groups"},
    }
    program = (
        "import atexit, gc, sys; from nrs_cosim.orchestrator.__main__ import main; "
        "searches = lambda: sum(one['collections'] for one in gc.get_stats()); "
        "before = searches(); "
        "atexit.register(lambda: print(searches() - before, *sys.modules, file=sys.stderr)); main()"
    )
    for command, unneeded in commands.items():
        done = subprocess.run(
            [sys.executable, "-c", program, *map(str, command)],
            cwd=ROOT, check=True, capture_output=True, text=True,
        )  # fmt: skip
        searches, *loaded = done.stderr.splitlines()[-1].split()
        assert searches in {"0", "1"}, "what is loaded was searched for cycles"
        assert "numpy" in loaded
        assert not unneeded.intersection(loaded), command[0]


README = ROOT / "README.md"


def test_the_demos_last_sentence_depends_on_the_run():
    scenario = nrs_cosim.Scenario.load(ROOT / "scenarios/paper_first_order.toml")
    with nrs_cosim.run(scenario) as recording:
        result = demo.sentence(recording)
        assert result.startswith(
            "6 robots, the run completed: the largest errors (estimates of position, "
        )
        assert result.endswith(") are within what is proven of them.")
        assert "BEYOND" not in result
    short = scenario.replace({"run.duration": 2.0})
    with nrs_cosim.run(short) as recording:
        assert "for the initial error is still there" in demo.sentence(recording)
    unstable = scenario.replace({"algorithm.alpha": 1.3, "run.divergence_limit": 100.0})
    with nrs_cosim.run(unstable) as recording:
        assert "the run failed" in demo.sentence(recording)


def test_the_readme_is_short():
    assert len(README.read_text("utf-8").splitlines()) <= 150


PAGES = [README, ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_within_the_project_lead_to_files(page):
    for link in re.findall(r"\]\(([^)#]+)[^)]*\)", page.read_text("utf-8")):
        if not link.startswith("https://"):
            assert (page.parent / link).exists(), link


@pytest.mark.parametrize("name", reference.PAGES)
def test_the_reference_is_as_make_reference_writes_it(name):
    assert (ROOT / "docs" / name).read_text("utf-8") == reference.PAGES[name]()


def dependencies():
    """What the package and its extras name, but for `all`, which names the extras of users."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = project["optional-dependencies"]
    (every,) = extras.pop("all")
    lists = re.fullmatch(r"nrs-cosim\[(.*)\]", every)[1].split(",")
    assert set(extras) - set(lists) == {"benchmark", "docs", "test", "viewers"}
    named = [*project["dependencies"], *(name for group in extras.values() for name in group)]
    return [re.split("[<>=]", requirement)[0] for requirement in named]


def test_every_dependency_earns_its_line_in_contributing():
    result = (ROOT / "CONTRIBUTING.md").read_text("utf-8")
    assert [name for name in dependencies() if name not in result] == []


def test_constraints_pin_every_dependency_and_name_no_place():
    pins = (ROOT / "constraints.txt").read_text("utf-8").splitlines()
    assert all(re.fullmatch(r"[\w.-]+==[\w.+]+", pin) for pin in pins)
    pinned = {re.sub("[-_.]+", "-", pin.split("==")[0]).lower() for pin in pins}
    assert [name for name in dependencies() if name.lower() not in pinned] == []


DOORS = ("nrs_cosim/api/", "orchestrator/cli/")
"""What a user calls has the name of what it calls."""
SHARED = {"main", "serve", "check", "Disturbance", "Recording", "Scenario", "Fmu", "phases_of"}
"""Each process has its main; a seam has one word on both sides; the rest is to be told apart."""


def test_a_public_name_has_one_meaning():
    homes: dict[str, list[str]] = {}
    for path in sorted(ROOT.glob("[bepro]*/**/*.py")):
        file = path.relative_to(ROOT).as_posix()
        if file.split("/")[0] not in {"bus", "estimator_agents", "plant_fmu", "recordings",
                                      "orchestrator"} or file.startswith(DOORS):  # fmt: skip
            continue
        for node in ast.parse(path.read_bytes()).body:
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                homes.setdefault(node.name, []).append(file)
    assert len(homes) > 500
    assert {name for name, files in homes.items() if len(files) > 1} <= SHARED


ARRAY = re.compile(r"\b(Array|ArrayLike|Mask|Matrix|NDArray|Nodes|Records)\b")
SHAPE = re.compile(r"\([^()]*[,…][^()]*\)|; (as|see) `")
"""As in (n, m), or a reference to where it stands."""


def public_functions(module):
    """Yield the functions of a module, and of its classes, with all that their docstrings say."""
    for node in ast.parse(module.read_bytes()).body:
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            functions, about = node.body, ast.get_docstring(node) or ""
        else:
            functions, about = [node], ""
        for one in functions:
            if isinstance(one, ast.FunctionDef) and (
                one.name == "__init__" or not one.name.startswith("_")
            ):
                yield one, f"{about} {ast.get_docstring(one) or ''}"


@pytest.mark.parametrize("folder", ["bus", "plant_fmu", "orchestrator/engine"])
def test_a_public_function_of_arrays_says_their_shapes(folder):
    silent = []
    for module in sorted((ROOT / folder).rglob("*.py")):
        for one, text in public_functions(module):
            types = [argument.annotation for argument in (*one.args.args, *one.args.kwonlyargs)]
            annotations = " ".join(ast.unparse(kind) for kind in (*types, one.returns) if kind)
            if ARRAY.search(annotations) and not SHAPE.search(text):
                silent.append(f"{module.relative_to(ROOT)}:{one.lineno} {one.name}")
    assert silent == []


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
def test_tests_wait_only_for_the_times_in_guard(path):
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


def test_slow_tests_exist_and_leave_tests_of_every_package():
    tests, fast = set(), set()
    listed = (ROOT / "tests" / "slow.txt").read_text("utf-8").split()
    for path in (ROOT / "tests").rglob("test_*.py"):
        name = path.relative_to(ROOT).as_posix()
        tests.add(name)
        for node in ast.parse(path.read_bytes()).body:
            inner = node.body if isinstance(node, ast.ClassDef) else [node]
            of = f"{name}::{node.name}" if isinstance(node, ast.ClassDef) else name
            found = {
                f"{of}::{each.name}"
                for each in inner
                if isinstance(each, ast.FunctionDef) and each.name.startswith("test_")
            }
            tests |= found
            fast |= set() if name in listed else found - {*listed}
    gone = [line for line in listed if line not in tests]
    assert gone == [], "tests/slow.txt names what is not there any more"
    packages = {"bus", "estimator_agents", "orchestrator", "plant_fmu", "recordings"}
    assert {name.split("/")[1] for name in fast} >= packages


RETIRED = {
    "befell",
    "believed",
    "hear",
    "heard",
    "hears",
    "owed",
    "promise",
    "promised",
    "promises",
    "sharp",
    "told",
    "verdict",
}
"""Words of our own for which the field has others, docs/glossary.md; a name has none of them."""


def test_no_name_is_a_retired_word():
    for path in sorted(ROOT.glob("[beprnodt]*/**/*.py")):
        file = path.relative_to(ROOT).as_posix()
        tree = ast.parse(path.read_bytes())
        names = {
            getattr(node, field)
            for node in ast.walk(tree)
            for field in ("id", "attr", "arg", "name")
            if isinstance(getattr(node, field, None), str)
        }
        assert not {name for name in names if name.strip("_").lower() in RETIRED}, file
