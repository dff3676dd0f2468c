"""The guide's algorithm is installed as the guide says, checked, and run."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from docs import reference
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.installed import (
    algorithm_names,
    bundled_algorithms,
    load_algorithm,
    policies_of,
)
from tests.cases import cases
from tests.command import nrs
from tests.estimator_agents.agents_without_bus import agents_at, meet
from tests.scenarios import PAPER, write

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "algorithms.md").read_text("utf-8")
NRS = Path(sys.executable).with_name("nrs")
LEAKY = {"algorithm.name": "leaky"}


CODES = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
(PACKAGE,) = map(tomllib.loads, re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL))
POINTS = PACKAGE["project"]["entry-points"]["nrs.algorithms"]


@pytest.fixture
def installed(tmp_path):
    """Return a folder with the guide's modules, and the metadata that an installer writes."""
    for code, place in zip(CODES, POINTS.values(), strict=True):
        module, kind = place.split(":")
        assert f"class {kind}(Algorithm):" in code
        assert len(code.splitlines()) <= 46
        (tmp_path / f"{module}.py").write_text(code, "utf-8")
    about = tmp_path / "leaky-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: leaky\nVersion: 1.0\n")
    lines = [f"{name} = {value}" for name, value in POINTS.items()]
    (about / "entry_points.txt").write_text("\n".join(["[nrs.algorithms]", *lines]) + "\n")
    return tmp_path


@pytest.mark.parametrize("name", cases([*POINTS], ["leaky", "looking"]))
def test_each_algorithm_of_the_guide_is_one_run_wherever_its_robots_are(
    installed, monkeypatch, name
):
    monkeypatch.syspath_prepend(str(installed))
    monkeypatch.setenv("PYTHONPATH", str(installed))
    gains = {"alpha": 0.7, "beta": 0.6} if name == "leaky" else {}
    shared = {"algorithm": {"name": name, **gains}, "run.duration": 5.0}
    write(installed / "s.toml", shared, {"faults.links": [{"loss": 0.1, "delay": 1}]})

    def said(*arguments):
        done = nrs(*arguments, cwd=installed)
        assert done.returncode == 0, done.stderr
        return done.stdout

    try:
        assert json.loads(said("check", "s.toml", "--json"))["algorithm"] == name
        said("run", "s.toml", "-o", "1.mcap")
        triggered = name in {"quiet", "ahead"}
        said("run", "s.toml", "-o", "2.mcap", "--workers", "3" if triggered else "2")
        one, two = (json.loads(said("info", f"{n}.mcap", "--json")) for n in (1, 2))
        assert one["digest"] == two["digest"]
        assert (one["samples"]["per_robot_and_second"] < 10) == triggered
        said("replay", "2.mcap", "--verify")
    finally:
        sys.modules.pop(name, None)


@pytest.mark.parametrize(("c0", "periods"), [(0.05, 2), (0.2, 4), (0.3, 5)])
def test_the_self_triggered_one_sends_when_a_parabola_has_left_its_tangent_by_c0(
    installed, monkeypatch, c0, periods
):
    """Of ε_0 = t² its velocity gains 2 rad/s a second: it plans ⌊√(2 c0/2)/h⌋ periods ahead."""
    monkeypatch.syspath_prepend(str(installed))
    algorithm = load_algorithm("ahead", {"c0": c0})
    schedule = TopologySchedule.constant(Topology.of(np.zeros((1, 1)), np.ones(1)))
    start = Estimate(np.zeros((1, 1)), np.zeros((1, 1)))
    agents, sent = agents_at(np.array([1]), schedule, algorithm, start), []
    for k in range(1, 121):
        t = 0.1 * k
        target = {"position": np.array([t * t]), "velocity": np.array([2 * t])}
        sent += [k] * len(meet([agents], k, 0.1, target))
    assert {*np.diff(sent[-8:])} == {periods}


def test_the_guides_algorithm_is_found_by_name(installed, monkeypatch):
    monkeypatch.syspath_prepend(str(installed))
    assert "leaky" in algorithm_names()
    assert policies_of("leaky") == ("hold", "drop")
    modes = load_algorithm("leaky", {"alpha": 0.9, "beta": 1.1}).modes(np.array([0.5]), 0.1)
    np.testing.assert_allclose(modes, [0.55, 0.44])


def test_an_algorithm_installed_while_running_is_found(installed, monkeypatch, tmp_path_factory):
    packages = tmp_path_factory.mktemp("packages")
    monkeypatch.syspath_prepend(str(packages))
    os.utime(packages, (0, 0))
    assert "leaky" not in algorithm_names()
    (installed / "leaky-1.0.dist-info").rename(packages / "leaky-1.0.dist-info")
    assert "leaky" in algorithm_names()


def test_the_guides_algorithm_checks_and_runs(installed):
    write(installed / "s.toml", LEAKY, {"algorithm.beta": 1.0})
    paths = os.pathsep.join(filter(None, [str(installed), os.environ.get("PYTHONPATH")]))
    environment = {**os.environ, "PYTHONPATH": paths}

    def nrs(*arguments):
        done = subprocess.run(
            [NRS, *arguments],
            check=False,
            cwd=installed,
            env=environment,
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    result = json.loads(nrs("check", "s.toml", "--json"))
    assert result["spectral_radius"] < 1
    assert [c["name"] for c in result["conditions"]][:1] == ["alpha"]
    nrs("run", "s.toml", "-o", "s.mcap")
    theory = json.loads(nrs("info", "s.mcap", "--json"))["theory"]
    position = theory["quantities"][0]
    assert [row["status"] for row in theory["quantities"]] == ["within"] * 4
    assert position["measured"] == pytest.approx(position["bounds"]["steady_state"], rel=1e-2)
    assert theory["measured_radius"] == pytest.approx(theory["spectral_radius"], rel=2e-2)


@pytest.fixture
def broken(installed, monkeypatch):
    """Return a call of the command on the guide's algorithm with a part of its code replaced."""
    monkeypatch.syspath_prepend(str(installed))
    module = installed / "leaky.py"
    right = module.read_text("utf-8")

    def command(name, scenario, was, now):
        assert right.count(was) == 1
        module.write_text(right.replace(was, now), "utf-8")
        write(installed / "s.toml", LEAKY, base=scenario)
        monkeypatch.delitem(sys.modules, "leaky", raising=False)
        monkeypatch.setattr(sys, "dont_write_bytecode", True)
        output = ["-o", "s.mcap"] if name == "run" else []
        done = nrs(name, "s.toml", *output, cwd=installed)
        lines = module.read_text("utf-8").splitlines()
        place = {line.strip(): f"at {module}:{i}" for i, line in enumerate(lines, 1)}
        return done, place

    yield command
    sys.modules.pop("leaky", None)


HETERO = "hetero_information"


def test_the_guides_algorithm_may_use_separate_digraphs(broken):
    done, _ = broken("check", HETERO, "Leaky consensus", "Leaky")
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("command", ["check", "run"])
@pytest.mark.parametrize(
    ("scenario", "was", "now", "result", "line"),
    [
        (
            HETERO,
            "def conditions(self, spectrum, h, velocity=None):",
            "def conditions(self, spectrum, h):",
            "leaky.conditions(spectrum, h, velocity): TypeError: Leaky.conditions() takes 3 "
            "positional arguments but 4 were given",
            "def conditions(self, spectrum, h):",
        ),
        (
            PAPER,
            "disagreement.velocity",
            "disagreement.velocty",
            "leaky.jump(estimate, disagreement): AttributeError: 'Disagreement' object has no "
            "attribute 'velocty'",
            "(1 - self.leak) * estimate.velocity + self.beta * disagreement.velocty,",
        ),
        (
            PAPER,
            "@dataclass(frozen=True)\n",
            "",
            "leaky: Leaky: is no dataclass; put @dataclass(frozen=True) above the class",
            "class Leaky(Algorithm):",
        ),
        (
            PAPER,
            "0.01, least=0, below=1",
            "1, least=0, below=1",
            "leaky: Leaky.leak: its default: expected less than 1, got 1",
            'leak: float = parameter("λ, what υ forgets at each t_k", 1, least=0, below=1)',
        ),
        (
            PAPER,
            "import numpy as np",
            "import nunpy as np",
            "leaky from 'leaky:Leaky': ModuleNotFoundError: No module named 'nunpy'",
            "import nunpy as np",
        ),
        (
            PAPER,
            "(1 - self.leak) * estimate.velocity + self.beta * disagreement.velocity",
            "0.0",
            "leaky.jump(estimate, disagreement): ValueError: expected a velocity of shape (4,), as "
            "it was given, got ()",
            "def jump(self, estimate, disagreement):",
        ),
    ],
    ids=["third argument", "typo", "no dataclass", "default", "import", "shape"],
)  # fmt: skip
def test_an_error_in_an_algorithm_is_one_line(broken, command, scenario, was, now, result, line):
    done, place = broken(command, scenario, was, now)
    assert done.stderr.replace("\n", "") == f"error: algorithm.name: {result}, {place[line]}"
    assert done.returncode == 2


def test_an_algorithm_cannot_write_its_arguments(broken):
    was = "        return Estimate("
    now = f"        if estimate.position.ndim == 2:\n            estimate.position += 1\n{was}"
    done, place = broken("run", PAPER, was, now)
    assert done.returncode == 2
    assert done.stderr.replace("\n", "") == (
        "error: algorithm.name: leaky.jump(estimate, disagreement): ValueError: output array is "
        "read-only, " + place["estimate.position += 1"]
    )


@pytest.mark.parametrize("layout", [(), ("--workers", "2")])
def test_non_finite_numbers_are_attributed_to_the_algorithm_on_any_workers(installed, layout):
    module = installed / "leaky.py"
    was, many = (
        "        return Estimate(",
        "estimate.position.ndim == 2 and np.ptp(estimate.position)",
    )
    endless = "estimate = Estimate(estimate.position + np.inf, estimate.velocity)"
    now = f"        if {many}:\n            {endless}\n{was}"
    module.write_text(module.read_text("utf-8").replace(was, now), "utf-8")
    write(installed / "s.toml", LEAKY)
    paths = os.pathsep.join(filter(None, [str(installed), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [NRS, "run", "s.toml", "-o", "s.mcap", *layout],
        check=False,
        cwd=installed,
        env={**os.environ, "PYTHONPATH": paths},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert re.search(
        r"algorithm leaky: jump returned a \w+ of \S+ for robot \d+ at tick \d+", done.stderr
    )
    assert "Traceback" not in done.stderr + done.stdout
    assert "FMU" not in done.stderr


def test_the_guides_package_has_the_modules_of_its_entry_points():
    modules = [place.partition(":")[0] for place in POINTS.values()]
    assert PACKAGE["tool"]["setuptools"]["py-modules"] == modules
    assert {"name", "version"} < PACKAGE["project"].keys()


def test_the_reference_leaves_out_algorithms_of_other_packages(installed, monkeypatch):
    monkeypatch.syspath_prepend(str(installed))
    assert "leaky" in algorithm_names()
    assert "leaky" not in reference.scenario_reference()


def test_the_guides_table_lists_all_algorithms():
    here = GUIDE.partition("## Those that are here")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| `(\w+)` \|", here, re.MULTILINE)
    assert sorted(rows) == sorted(bundled_algorithms())
