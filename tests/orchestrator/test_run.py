"""Whole runs: real FMUs, a real Zenoh session, a real file, against an independent oracle."""

import numpy as np
import pytest

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, lines, measure
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.plant_fmu.errors import StepError
from nrs_cosim.recordings.export.tables import samples, states
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.orchestrator.run_oracle import simulate
from tests.scenarios import SCENARIOS, SECOND_ORDER, SHORT, drawn, paper

SEEDED = {"run.seed": 11}
EXPLICIT = {
    "initial.position": [[5, -3], [0.5, 8], [-7, 2], [1, 1], [24, -24], [0, 0]],
    "initial.velocity": [[1, 2], [-3, 4], [0, 0], [10, -10], [2, 2], [-1, -8]],
    "initial.q": [[0.1, -0.2], [3, 1], [-2, 5], [0, 0], [20, -20], [1.5, -1.5]],
    "initial.qd": [[0, 0], [5, -5], [-25, 25], [1, 2], [3, 4], [0, -1]],
}


def rows_of(tables, n):
    """Return a recording's rows as an array (ticks or times, robots), sorted by time."""
    table = np.concatenate(list(tables))
    return table[np.lexsort((table["robot"], table["time_ns"]))].reshape(-1, n)


STARTS = [(1, EXPLICIT), (2, SEEDED), (1, SEEDED), (2, EXPLICIT)]


@pytest.mark.parametrize(("order", "start"), cases(STARTS, STARTS[1:2]))
def test_twenty_seconds_agree_with_dop853(tmp_path, order, start):
    file = paper({"run.duration": 20.0}, start, SECOND_ORDER if order == 2 else {})
    outcome = run(file, tmp_path / "run.mcap")
    assert (outcome.status, outcome.ticks) == ("completed", 200)
    with Reader(outcome.path) as reader:
        recorded, sampled = rows_of(states(reader), 6), rows_of(samples(reader), 7)
    at_t_k = recorded[::5]
    alpha, beta = (0.9, 1.1) if order == 1 else (1.1, 0.9)
    first = at_t_k[0]
    times, q, estimates = simulate(
        order,
        alpha,
        beta,
        0.1,
        20,
        first["reference_position"],
        first["reference_velocity"],
        first["position"],
        first["velocity"],
    )
    np.testing.assert_allclose(at_t_k["time_ns"][:, 0] / 1e9, times, atol=1e-12)
    assert np.abs(at_t_k["position"] - q).max() < 1e-7
    for name, ours in (("position", 0), ("velocity", 1)):
        scale = np.abs(estimates[1:, ours]).max()
        np.testing.assert_allclose(
            sampled[name][:, 1:], estimates[1:, ours], rtol=1e-12, atol=1e-12 * scale
        )
        assert sampled[name][:, 1:].tolist() == at_t_k[f"reference_{name}"][1:].tolist()
    if start is EXPLICIT:
        assert first["position"][1].tolist() == [3, 1]
        assert first["reference_velocity"][3].tolist() == [10, -10]


STEADY = {  # paper.md's table: sup of position and velocity estimates, of e and e-dot
    "1a": (0.15131, 0.43971, 0.444, 0.497),
    "2a": (0.04018, 0.22535, 0.243, 0.268),
    "2b": (0.15131, 0.43971, 0.444, 0.497),
    "2c": (1.3575, 1.3545, 1.58, 1.67),
    "3a": (0.38275, 0.42193, 0.444, 0.470),
    "3b": (2.4192, 2.6095, 2.54, 2.70),
}


@pytest.mark.parametrize("case", STEADY)
def test_steady_state_of_the_papers_cases(case, tmp_path):
    file = read_scenario(SCENARIOS / f"paper_example_{case}.toml")
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        measured = measure(reader, experiment_of(reader))
    position, velocity, e, ed = STEADY[case]
    assert measured.position_estimate == pytest.approx(position, rel=0.01)
    assert measured.velocity_estimate == pytest.approx(velocity, rel=0.01)
    assert measured.position_tracking == pytest.approx(e, rel=0.03)
    assert measured.velocity_tracking == pytest.approx(ed, rel=0.03)


def test_steady_state_just_inside_the_bound(tmp_path):
    file = read_scenario(SCENARIOS / "paper_example_1b.toml")
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        measured = measure(reader, experiment_of(reader))
    assert 0.111 * 0.99 < measured.position_estimate < 0.123 * 1.01
    assert measured.velocity_estimate == pytest.approx(0.4153, rel=0.01)


@pytest.mark.parametrize(
    ("case", "radius", "factor"),
    [("1c", 1.014386, 1.5), ("3c", 1.007636, 1.1)],  # rho of paper.md; 1c's mode is defective
)
def test_outside_the_bound_the_error_grows_by_the_spectral_radius(case, radius, factor, tmp_path):
    outcome = run(read_scenario(SCENARIOS / f"paper_example_{case}.toml"), tmp_path / "run.mcap")
    assert outcome.status == "completed"
    with Reader(outcome.path) as reader:
        sampled = rows_of(samples(reader), 7)
    error = np.abs(sampled["position"][:, 1:] - sampled["position"][:, :1]).max(axis=(1, 2))
    growth = error[-50:].max() / error[-150:-100].max()
    assert radius**100 / factor < growth < radius**100 * factor


def test_a_run_beyond_the_divergence_limit_fails_with_the_time(tmp_path):
    file = paper({"algorithm.alpha": 1.18, "algorithm.beta": 1.18, "run.divergence_limit": 1000})
    outcome = run(file, tmp_path / "run.mcap")
    assert outcome.status == "failed"
    assert outcome.reason.startswith("diverged at t = ")
    assert "run.divergence_limit = 1000" in outcome.reason
    with Reader(outcome.path) as reader:
        assert (reader.status, reader.reason) == ("failed", outcome.reason)
        assert reader.damage == []
        assert reader.ticks == outcome.ticks > 10
        assert (
            np.concatenate(list(states(reader)))["position"].size == (1 + 5 * reader.ticks) * 6 * 2
        )


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"initial.position.uniform": [-2e3, -1.5e3]}, "estimated position"),
        ({"initial.velocity.uniform": [-2e3, -1.5e3]}, "estimated velocity"),
        ({"initial.q.uniform": [-2e3, -1.5e3]}, "q"),
        ({"initial.qd.uniform": [-2e3, -1.5e3]}, "qd"),
    ],
    ids=["position", "velocity", "q", "qd"],
)
def test_each_quantity_beyond_the_limit_ends_the_run(tmp_path, change, name):
    limit = {"run.divergence_limit": 1000}
    outcome = run(paper(limit, change), tmp_path / "run.mcap")
    assert outcome.status == "failed"
    assert f"diverged at t = 0 s: robot 1's {name} is [-1" in outcome.reason


def test_a_non_finite_torque_fails_the_run_before_it_is_recorded(tmp_path):
    with pytest.raises(
        StepError, match=r"robot 1 \(two_link_arm\) at t = 0 s: .* not finite: \[.*inf"
    ):
        run(paper({"controller.kp": 1e308}), tmp_path / "run.mcap")
    assert not (tmp_path / "run.mcap").exists()


def test_a_diverging_run_without_limit_ends_before_a_non_finite_number(tmp_path):
    """With gains of 1e200 the second jump leaves the doubles; no NaN is ever recorded."""
    file = paper({"algorithm.alpha": 1e200, "algorithm.beta": 1e200, "run.divergence_limit": 1e308})
    outcome = run(file, tmp_path / "run.mcap")
    assert outcome.status == "failed"
    assert " t = 0." in outcome.reason
    with Reader(outcome.path) as reader:
        for table in (*samples(reader), *states(reader)):
            assert np.isfinite(table["position"]).all()


def digest_of(file, path, **options):
    with Reader(run(file, path, **options).path, verify=True) as reader:
        assert reader.damage == []
        return reader.digest


def test_the_digest_depends_only_on_the_scenario(tmp_path):
    first = digest_of(paper(SHORT), tmp_path / "a.mcap")
    assert digest_of(paper(SHORT), tmp_path / "b.mcap") == first
    for compression in ("lz4", "none"):
        path = tmp_path / f"{compression}.mcap"
        assert digest_of(paper(SHORT), path, compression=compression) == first
    assert digest_of(paper(SHORT, {"run.seed": 2}), tmp_path / "c.mcap") != first
    sizes = {path.stat().st_size for path in tmp_path.glob("*.mcap")}
    assert len(sizes) >= 3


def test_each_robot_has_its_own_drive(tmp_path):
    """Two solvers and a held torque in one run, beside the run that the FMU itself integrates."""
    rk4 = {"fmu": "two_link_arm", "solver": "rk4", "step": 0.002}
    held = {"fmu": "two_link_arm", "control": "hold", "control_step": 0.002}
    adaptive = {"plant.solver": "cvode", "plant.rtol": 1e-10}
    driven = paper(SHORT, adaptive, {"robots": [{"id": 2, "plant": rk4}, {"id": 5, "plant": held}]})
    q = {}
    for name, file in (("driven", driven), ("alone", paper(SHORT))):
        with Reader(run(file, tmp_path / f"{name}.mcap").path) as reader:
            q[name] = rows_of(states(reader), 6)["position"]
            result = describe(reader, experiment_of(reader))
            lines_of = lines(result, measure(reader, experiment_of(reader)))
        if name == "driven":
            by_robots = {tuple(plant["robots"]): plant for plant in result["plants"]}
            assert {robots: plant["kind"] for robots, plant in by_robots.items()} == {
                (1, 3, 4, 6): "ModelExchange",
                (2,): "ModelExchange",
                (5,): "CoSimulation",
            }
            assert by_robots[1, 3, 4, 6]["drive"] == "Model Exchange, CVODE rtol 1e-10"
            assert by_robots[2,]["drive"] == "Model Exchange, RK4 step 0.002 s"
            assert by_robots[5,]["drive"].startswith("torque held for 0.002 s (error about 0.0")
            assert by_robots[5,]["why"].endswith("the scenario asks for it")
            assert "torque held for 0.002 s" in lines_of["plants"]
    error = np.abs(q["driven"] - q["alone"]).max(axis=(0, 2))
    assert error[[0, 2, 3, 5]].max() < 1e-7
    assert error[1] < 1e-6
    assert 1e-4 < error[4] < 0.1


def test_the_recording_carries_its_scenario(tmp_path):
    file = paper(SHORT)
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        assert experiment_of(reader).scenario == file.scenario
        assert experiment_of(reader).text == file.text
        about = reader.metadata["nrs.run"]
        assert (about["robots"], about["joints"], about["seed"], about["ticks"]) == (
            "6", "2", "1", "10",
        )  # fmt: skip
        assert reader.metadata["nrs.versions"].keys() >= {"nrs-cosim", "fmpy", "eclipse-zenoh"}


def test_planar_robots_converge_to_a_target_at_rest(tmp_path):
    """m q̈ + d q̇ = kp (ε − q) + kd (υ − q̇) with ε at rest has its equilibrium at q = ε, τ = 0."""
    planar = paper(
        {
            "target.axes": [{"offset": 4.0}, {"offset": -1.0}],
            "plant.fmu": "planar_robot",
            "disturbance": None,
        }
    )
    outcome = run(planar, tmp_path / "run.mcap")
    with Reader(outcome.path) as reader:
        last = rows_of(states(reader), 6)[-1]
    np.testing.assert_allclose(last["position"], np.tile([4.0, -1.0], (6, 1)), atol=1e-6)
    np.testing.assert_allclose(last["effort"], 0, atol=1e-3)


def test_the_scenario_sets_the_number_of_links_of_an_arm(tmp_path):
    """Seven links, set by the structural parameter, follow seven axes."""
    links = paper(
        {
            "run": {"duration": 6.0, "sampling_period": 0.1},
            "network": {"adjacency": [[0, 0], [1, 0]], "pinning": [1, 0]},
            "target.axes": [{}] * 7,
            "plant": {"fmu": "n_link_arm", "parameters": {"n": 7, "g": 0.0}},
            "disturbance": None,
            "initial": drawn(-1, 1),
        }
    )
    outcome = run(links, tmp_path / "run.mcap")
    assert outcome.status == "completed", outcome.reason
    with Reader(outcome.path) as reader:
        q = rows_of(states(reader), 2)["position"]
    assert q.shape == (61, 2, 7)
    assert np.abs(q[0]).max() > 0.5
    assert np.abs(q[-1]).max() < 0.05


def test_a_robots_own_disturbance_moves_only_that_robot(tmp_path):
    own = {"robots": [{"id": 3, "disturbance": {"axes": [{"offset": 50.0}, {}]}}]}
    tables = []
    for name, change in (("all", {}), ("own", own)):
        with Reader(run(paper(SHORT, change), tmp_path / f"{name}.mcap").path) as reader:
            tables.append(rows_of(states(reader), 6)["position"])
    moved = (tables[0][1:] != tables[1][1:]).all(axis=(0, 2))
    assert moved.tolist() == [False, False, True, False, False, False]


def test_robots_of_different_models_run_together(tmp_path):
    """A robot with another FMU changes its own states and nothing else."""
    plant = {"fmu": "planar_robot", "parameters": {"m": 5.0}}
    tables = []
    for name, change in (("arms", {}), ("mixed", {"robots": [{"id": 3, "plant": plant}]})):
        with Reader(run(paper(SHORT, change), tmp_path / f"{name}.mcap").path) as reader:
            tables.append((rows_of(samples(reader), 7), rows_of(states(reader), 6)))
    (samples_a, states_a), (samples_b, states_b) = tables
    assert samples_a.tobytes() == samples_b.tobytes()
    others = [0, 1, 3, 4, 5]
    assert states_a[:, others].tobytes() == states_b[:, others].tobytes()
    assert (states_a["position"][1:, 2] != states_b["position"][1:, 2]).all()
