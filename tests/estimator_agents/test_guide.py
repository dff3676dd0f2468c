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

from estimator_agents.algorithm import algorithm_names, load_algorithm, policies_of

ROOT = Path(__file__).parents[2]
GUIDE = (ROOT / "docs" / "algorithms.md").read_text("utf-8")
PAPER = (ROOT / "scenarios" / "paper_first_order.toml").read_text("utf-8")
NRS = Path(sys.executable).with_name("nrs")


@pytest.fixture
def installed(tmp_path):
    """Return a folder with the guide's module, and the metadata that an installer writes of it."""
    (code,) = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
    (entry,) = re.findall(r"```toml\n(.*?)```", GUIDE, re.DOTALL)
    assert len(code.splitlines()) <= 34
    points = tomllib.loads(entry)["project"]["entry-points"]["nrs.algorithms"]
    (tmp_path / "leaky.py").write_text(code, "utf-8")
    about = tmp_path / "leaky-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: leaky\nVersion: 1.0\n")
    lines = [f"{name} = {value}" for name, value in points.items()]
    (about / "entry_points.txt").write_text("\n".join(["[nrs.algorithms]", *lines]) + "\n")
    return tmp_path


def test_the_guide_s_algorithm_is_found_by_name(installed, monkeypatch):
    monkeypatch.syspath_prepend(str(installed))
    assert "leaky" in algorithm_names()
    assert policies_of("leaky") == ("hold", "drop")
    modes = load_algorithm("leaky", 0.9, 1.1).modes(np.array([0.5]), 0.1)
    np.testing.assert_allclose(modes, [0.55, 0.44])


def test_the_guide_s_algorithm_checks_and_runs(installed):
    text = PAPER.replace('name = "dcea1"', 'name = "leaky"').replace("beta = 1.1", "beta = 1.0")
    (installed / "s.toml").write_text(text, "utf-8")
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

    told = json.loads(nrs("check", "s.toml", "--json"))
    assert told["spectral_radius"] < 1
    assert [c["name"] for c in told["conditions"]][:1] == ["alpha"]
    nrs("run", "s.toml", "-o", "s.mcap")
    theory = json.loads(nrs("info", "s.mcap", "--json"))["theory"]
    position = theory["quantities"][0]
    assert [row["verdict"] for row in theory["quantities"]] == ["within"] * 4
    assert position["measured"] == pytest.approx(position["exact"], rel=1e-2)
    assert theory["measured_factor"] == pytest.approx(theory["factor"], rel=2e-2)


def test_the_guide_s_table_names_all_algorithms():
    rows = re.findall(r"^\| `(\w+)` \|", GUIDE, re.MULTILINE)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    assert sorted(rows) == sorted(project["entry-points"]["nrs.algorithms"])
