"""ρ over two axes of a scenario, against eigenvalues of dense matrices and what `check` says."""

import json
from itertools import product

import numpy as np
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.analysis.conditions import check
from nrs_cosim.orchestrator.analysis.convergence import UNKNOWN
from nrs_cosim.orchestrator.study import radius_map as module
from nrs_cosim.orchestrator.study.axes import axis_of, with_draw
from nrs_cosim.orchestrator.study.radius_map import RadiusMap, _growth_beyond, radius_map
from tests.cases import cases
from tests.command import nrs
from tests.scenarios import paper, toml

SECOND = {"algorithm": {"name": "dcea2", "alpha": 1.1, "beta": 0.9}}
THREE = {"network": {"adjacency": [[0, 0, 1], [1, 0, 1], [0, 1, 0]], "pinning": [1, 0, 0]}}
LINKS = {"faults.links": [{"delay": 0, "loss": 0.0}]}
RANGES = {
    "algorithm.alpha": (0.2, 1.6),
    "algorithm.beta": (0.2, 1.6),
    "run.sampling_period": (0.05, 1.0),
    "faults.links.0.delay": (0, 3),
    "faults.links.0.loss": (0.0, 0.8),
}


def radius(alpha, beta, h, delay, loss):
    """Return ρ of the second-order DCEA on three robots, of agents that drop what is lost.

    With losses it is ρ(E[A ⊗ A])^½ over all outcomes of the edges, the target's among them.
    """
    weights = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 0]], float)
    edges = np.argwhere(weights)
    F, G = np.array([[1, h], [0, 1]]), np.array([[0, 0], [alpha, beta]])
    size = 6 * (delay + 1)
    mean = np.zeros((size**2 if loss else size,) * 2)
    for lost in product([0, 1], repeat=len(edges)) if loss else [(0,) * len(edges)]:
        there = weights.copy()
        there[tuple(edges[np.array(lost) == 1].T)] = 0
        received = there.sum(axis=1, keepdims=True)
        D = np.divide(there, received, out=np.zeros_like(there), where=received > 0)[:, 1:]
        A = np.eye(size, k=-6)
        A[:6, :6] = np.kron(F, np.eye(3)) - np.kron(F @ G, np.diag(received[:, 0] > 0))
        A[:6, -6:] += np.kron(F @ G, D)
        chance = np.prod(np.where(lost, loss, 1 - loss))
        mean += chance * (np.kron(A, A) if loss else A)
    found = np.abs(np.linalg.eigvals(mean)).max()
    return found**0.5 if loss else found


@pytest.mark.parametrize("seed", range(cases(34, 3)))
def test_points_of_maps_over_any_two_axes_are_those_of_dense_matrices_and_of_check(
    seed, monkeypatch
):
    monkeypatch.setattr(module, "growth_over", lambda _: UNKNOWN)  # takes its time, and is no ρ
    rng = np.random.default_rng(seed)
    x, y = rng.choice(list(RANGES), 2, replace=False)
    if seed == 1:
        x, y = "faults.links.0.delay", "faults.links.0.loss"
    values = {}
    for key in (x, y):
        low, high = RANGES[key]
        drawn = rng.integers(0, 3, 3) if key.endswith("delay") else rng.uniform(low, high, 3)
        values[key] = [int(v) if key.endswith("delay") else round(float(v), 3) for v in drawn]
    point = {"alpha": 1.1, "beta": 0.9, "h": 0.1, "delay": 0, "loss": 0.0}
    scenario = SECOND | THREE | LINKS | {"algorithm.missing": "drop", "initial": {}}
    made = radius_map(paper(scenario), [f"{k}={','.join(map(str, values[k]))}" for k in (x, y)])
    names = {"sampling_period": "h"}
    short = [names.get(key.split(".")[-1], key.split(".")[-1]) for key in (x, y)]
    for (row, b), (column, a) in product(enumerate(values[y]), enumerate(values[x])):
        at = point | dict(zip(short, (a, b), strict=True))
        assert made.lower[row, column] <= made.upper[row, column] + 1e-12
        assert made.upper[row, column] == pytest.approx(radius(**at), rel=1e-6)
    times = {"run.output_step": values[x][0]} if x.endswith("period") else {}
    times |= {"run.output_step": values[y][0]} if y.endswith("period") else {}
    if times:
        times["run.duration"] = round(40 * times["run.output_step"], 6)
    found = check(paper(scenario, {x: values[x][0], y: values[y][0]}, times)).links.radius
    assert made.upper[0, 0] == pytest.approx(found.upper)


def test_the_command_prints_marks_json_and_a_figure(tmp_path):
    (tmp_path / "s.toml").write_text(toml(SECOND))
    over = ["--over", "algorithm.alpha=0.5:2.5:5", "--over", "run.sampling_period=0.1,0.8"]
    printed = nrs("check", "s.toml", *over, "--figure", "map.svg", cwd=tmp_path)
    assert printed.returncode == 0, printed.stderr
    assert (tmp_path / "map.svg").read_bytes().startswith(b"<?xml")
    found = json.loads(nrs("check", "s.toml", *over, "--json", cwd=tmp_path).stdout)
    assert found["x"] == {"keys": ["algorithm.alpha"], "values": [0.5, 1.0, 1.5, 2.0, 2.5]}
    marks = "".join("." if value < 1 else "#" for value in found["upper"][1])
    assert f"0.8        {marks}" in printed.stdout


@pytest.mark.parametrize(
    ("over", "why"),
    [
        (["algorithm.alpha=1,2"], "--over: a map is over two axes, got 1"),
        (["algorithm.alpha=1,2", "algorithm.beta=0.1:1"], "algorithm.beta: of a range a:b values"),
        (["algorithm.alpha=1,2", "algorithm.gamma=1,2"], "gamma"),
    ],
)
def test_axes_that_make_no_map_are_refused(over, why):
    with pytest.raises(InputError, match=why):
        radius_map(paper(SECOND), over)


@pytest.mark.parametrize("seed", range(6))
def test_what_almost_every_run_does_is_looked_for_on_both_sides_of_its_line(seed):
    """On fields with one line each; where ρ is below 1 nowhere all places are looked at."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 7))
    growth = 0.6 + x * rng.uniform(0.2, 0.8) + y * rng.uniform(0.2, 0.8)
    radius = growth + (0.05 + 0.2 * y if seed else 1.0)
    found, _ = _growth_beyond(radius, lambda place: (growth[place],) * 2)
    seen = np.isfinite(found)
    assert (found[seen] == growth[seen]).all()
    assert seen.all() == (seed == 0)
    for axis in (0, 1):
        inside = np.swapaxes(growth < 1, 0, axis)
        pairs = inside[1:] != inside[:-1]
        there = np.swapaxes(seen, 0, axis)
        assert (there[1:] & there[:-1])[pairs].all()


def test_places_where_almost_every_run_converges_have_a_mark_and_numbers():
    axes = with_draw([axis_of("--over", text) for text in ("k.x=1,2", "k.y=3,4")], None)
    radius = np.array([[0.9, 1.1], [1.2, 1.3]])
    growth = np.array([[0.8, 0.95], [0.99, 1.1]])
    made = RadiusMap((axes[0], axes[1]), radius, radius, (growth - 0.02, growth + 0.02))
    assert [made.lines()[row] for row in "43"] == ["##", ".o"]  # 0.99 may be 1.01
    assert made.lines()["marks"].startswith(". ρ < 1, o ρ >= 1, and almost every run converges")
    assert made.as_json()["almost_sure"][0] == pytest.approx([0.82, 0.97])
