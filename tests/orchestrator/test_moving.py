"""An FMU may be the target: it is run once, and its samples then go with the text."""

import hashlib
import json
import shutil
from zipfile import ZipFile

import numpy as np
import pytest

from nrs_cosim.estimator_agents.target import Sampled
from nrs_cosim.orchestrator.analysis.bounds import ultimate_bounds
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, lines, measure
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.scenario.file import changed, parse_scenario, read_scenario
from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.recording import Recording
from tests.cluster.local_workers import LocalRun
from tests.orchestrator.run_oracle import target
from tests.plant_fmu.test_motion import NAMES, PARAMETERS
from tests.scenarios import PAPER_FILE, SHORT, paper, toml, write

MOVER = {"kind": "fmu", "fmu": "planar_robot", "variables": NAMES, "parameters": PARAMETERS}
BRIEF = {"run.duration": 0.3}


def read(folder, target=MOVER, *changes):
    """Write the paper's example with another target, and read it."""
    return read_scenario(write(folder / "moving.toml", {"target": target}, *changes))


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The paper's run, and the same after an FMU that moves as its target does: recordings."""
    folder = tmp_path_factory.mktemp("moving")
    run(read_scenario(PAPER_FILE), folder / "harmonic.mcap")
    run(read(folder), folder / "moving.mcap")
    with Reader(folder / "harmonic.mcap") as one, Reader(folder / "moving.mcap") as other:
        yield one, other


def test_a_comment_does_not_matter(tmp_path):
    expected = read(tmp_path, MOVER, BRIEF).scenario
    text = (tmp_path / "moving.toml").read_text("utf-8")
    (tmp_path / "moving.toml").write_text(f'# what is "what is times" for?\n{text}', "utf-8")
    assert read_scenario(tmp_path / "moving.toml").scenario == expected


def test_a_run_after_the_fmu_agrees_with_the_formula(ran):
    one, other = (Recording(reader.path) for reader in ran)
    with one, other:
        for table in ("samples", "states"):
            a, b = getattr(one, table)(), getattr(other, table)()
            for name in a.dtype.names:
                np.testing.assert_allclose(b[name], a[name], rtol=0, atol=1e-9)


def test_the_targets_samples_are_those_of_the_fmu(ran):
    """At t_k the bits are those in the text, which test_motion has from FMPy."""
    scenario = experiment_of(ran[1]).scenario
    known = dict(zip(scenario.target.times, scenario.target.positions, strict=True))
    with Recording(ran[1].path) as recording:
        rows = recording.samples(robots=[0])
    assert len(rows) == 300
    for row in rows:
        assert tuple(row["position"]) == known[row["t"]]


def test_the_run_can_be_repeated_from_the_recording_alone(ran):
    file = experiment_of(ran[1])
    digest = hashlib.sha256(build("planar_robot").read_bytes()).hexdigest()
    assert file.scenario.target.sha256 == digest
    result = describe(ran[1], experiment_of(ran[1]))
    assert result["target"] == {"fmu": "planar_robot", "sha256": digest}
    assert (
        lines(result, measure(ran[1], experiment_of(ran[1])))["target"]
        == f"planar_robot, SHA-256 {digest}"
    )
    assert describe(ran[0], experiment_of(ran[0]))["target"] is None
    verification = verify(ran[1], file, plants=False)
    assert verification.difference is None
    assert verification.ticks == 300
    other = changed(file, [Change.of("--algorithm", "algorithm.alpha=0.8")])
    assert other.scenario.target == file.scenario.target


def test_any_number_of_workers_gives_one_digest(tmp_path):
    file = read(tmp_path, MOVER, SHORT)
    outcomes = [run(file, tmp_path / "1.mcap"), LocalRun(file, 2).run(tmp_path / "2.mcap")]
    with Reader(tmp_path / "1.mcap") as one, Reader(tmp_path / "2.mcap") as two:
        assert two.digest == one.digest
        assert [outcome.ticks for outcome in outcomes] == [10, 10]


def test_bounds_of_an_fmu_target_are_of_its_cubics(ran):
    """γ1 and γ2 are of the cubics: those of the formula, to h²/192 with a quarter of h."""
    scenario = experiment_of(ran[1])
    result = ultimate_bounds(scenario)
    assert result.steady_state is None
    assert result.gamma_1 == pytest.approx(3.0, abs=1e-9)
    assert result.gamma_2 == pytest.approx(1.0, abs=1e-4)
    assert result.source == "of the cubics through 1501 samples of planar_robot"
    compared = compare_to_theory(ran[1], scenario, measure(ran[1], experiment_of(ran[1])))
    assert [row.against_bound for row in compared.quantities] == ["within"] * 4


@pytest.mark.parametrize(
    "form",
    [
        "[target]\nkind = 'fmu'  # it moves\nfmu = 'two_link_arm'\n"
        "variables = {position = 'q', velocity = 'qd'}\n[target.parameters]\nm1 = 0.5",
        "target = {kind = 'fmu', fmu = 'two_link_arm', "
        "variables = {position = 'q', velocity = 'qd'}}",
        "target.kind = 'fmu'\ntarget.fmu = 'two_link_arm'\n"
        "target.variables = {position = 'q', velocity = 'qd'}",
    ],
)
def test_the_fmus_samples_travel_beside_the_unchanged_text(tmp_path, form):
    rest = toml(BRIEF, {"target": None})
    text = f"{rest}\n{form}" if form[0] == "[" else f"{form}\n{rest}"
    (tmp_path / "moving.toml").write_text(text, "utf-8")
    file = read_scenario(tmp_path / "moving.toml")
    again = parse_scenario(file.text, "again", tmp_path / "elsewhere", "again", file.assets)
    assert again.scenario == file.scenario
    assert len(again.scenario.target.times) == 16
    assert file.text == text


@pytest.mark.parametrize(
    ("step", "output", "count"), [(None, 0.1, 12), (None, 0.01, 30), (0.03, 0.05, 12), (1, 0.1, 3)]
)
def test_an_fmu_target_is_sampled_at_output_times_and_between(tmp_path, step, output, count):
    mover = MOVER | ({"step": step} if step else {})
    file = read(tmp_path, mover, BRIEF, {"run.output_step": output})
    clock, sampled = file.clock, file.scenario.target
    times = sampled.times
    outputs = {ns / 1e9 for k in range(clock.ticks + 1) for ns in clock.outputs(k)}
    assert outputs <= set(times)
    assert len(times) == count + 1
    assert max(np.diff(times)) <= (step or 0.025) * (1 + 1e-9)
    expected = np.array([target(t) for t in times])
    np.testing.assert_allclose(sampled.positions, expected[:, 0], rtol=0, atol=1e-11)
    np.testing.assert_allclose(sampled.velocities, expected[:, 1], rtol=0, atol=1e-11)


def test_hermite_cubics_interpolate_their_samples():
    rng = np.random.default_rng(7)
    times = np.cumsum(rng.uniform(0.01, 0.1, 50))
    positions, velocities = rng.normal(size=(2, 50, 3))
    motion = Sampled.through(times, positions, velocities)
    there = motion.at(times)
    assert there.position.tolist() == positions.tolist()
    assert there.velocity.tolist() == velocities.tolist()
    assert np.isnan(motion.at(times[-1] + 1e-6).position).all()
    dense = motion.at(np.linspace(times[0], times[-1], 200_001))
    gamma_1, gamma_2 = motion.bounds()
    steps = np.diff(dense.velocity, axis=0) / np.diff(np.linspace(times[0], times[-1], 200_001))[0]
    assert gamma_1 * 0.9999 < np.abs(dense.velocity).max() <= gamma_1 * (1 + 1e-12)
    assert gamma_2 * 0.99 < np.abs(steps).max() <= gamma_2 * (1 + 1e-6)


BAD_TABLES = {
    "not run": (MOVER, "target.fmu: 'planar_robot' is read where a scenario file is, and did not"),
    "no fmu": ({"kind": "fmu"}, "target.fmu: missing"),
    "key of the other kind": (
        {"kind": "fmu", "fmu": "planar_robot", "file": "a.csv"},
        "target.file: unknown key",
    ),
    "samples in the text": (
        {"kind": "fmu", "fmu": "a.fmu", "times": [0, 40]},
        "target.times: unknown key",
    ),
}


@pytest.mark.parametrize("case", BAD_TABLES)
def test_an_error_in_the_target_table_names_field_and_value(case):
    given, message = BAD_TABLES[case]
    with pytest.raises(ScenarioError) as error:
        paper({"target": given})
    assert f"paper.toml: {message}" in str(error.value)


BAD_RUNS = {
    "missing": ({"target.fmu": "none.fmu"}, "target.fmu: .*none.fmu: no such FMU"),
    "unknown": ({"target.fmu": "planar_robt"}, "target.fmu: .*planar_robt"),
    "misspelt": (
        {"target.variables": {"postion": "q", "velocity": "qd"}},
        "target.variables.postion: .*did you mean 'position'",
    ),
    "not found": ({"target.variables.position": "x"}, "has no variable 'x' for position"),
    "not said": (
        {"target.variables": None},
        r"planar_robot: has no variable 'position'; a robot's q is there. Write in the scenario's "
        r'\[target\]: variables.position = "q"$',
    ),
    "an input": (
        {"target.variables.position": "position_ref"},
        "planar_robot: variables.position = position_ref: an input, which nothing sets, so that "
        'the target would stand still; take an output or a state, "q"$',
    ),
    "parameter": (
        {"target.parameters.relative": 1e-9},
        "target.fmu: .*no parameter 'relative'",
    ),
    "size": (
        {"target.variables": {"position": "q[0:1]", "velocity": "qd[0:1]"}},
        "disturbance.axes: expected 1 axes, one for each of the target's axes, got 2",
    ),
    "not its velocity": (
        {"target.variables.velocity": ["qd[1:2]", "qd[0:1]"]},
        "velocity_1 at t = .* as the positions have it.*; name them in target.variables$",
    ),
    "too many": ({"target.step": 1e-7}, "target.step: .*1000000 samples"),
}


@pytest.mark.parametrize("case", BAD_RUNS)
def test_an_error_of_the_target_fmu_names_the_file_and_the_fault(tmp_path, case):
    change, message = BAD_RUNS[case]
    with pytest.raises(ScenarioError, match=message) as error:
        read(tmp_path, MOVER, change)
    assert "moving.toml: " in str(error.value)


def test_an_error_elsewhere_is_reported_without_running_the_fmu(tmp_path, monkeypatch):
    monkeypatch.setattr("nrs_cosim.plant_fmu.motion.fmu_motion", None)
    with pytest.raises(ScenarioError, match=r"run\.seed"):
        read(tmp_path, MOVER, {"run.seed": -1})


def test_the_schema_has_fmu_targets():
    kinds = json.loads(json.dumps(json_schema()))["$defs"]["FmuTarget"]["properties"]
    assert {"kind", "fmu", "parameters", "variables", "step", "isolate", "deadline"} <= kinds.keys()


def test_a_third_party_fmu_is_only_needed_when_the_scenario_is_read(tmp_path):
    shutil.copy(build("two_link_arm", 2), tmp_path / "arm.fmu")
    with (tmp_path / "arm.fmu").open("ab") as file:
        file.write(b"\0")  # another digest: none of ours
    arm = {"kind": "fmu", "fmu": "arm.fmu", "variables": {"position": "q", "velocity": "qd"}}
    file = read(tmp_path, arm, BRIEF)
    assert file.target.at(0.3).position.tolist() == list(file.scenario.target.positions[-1])
    (tmp_path / "arm.fmu").unlink()
    assert run(file, tmp_path / "run.mcap").ticks == 3


JITTER = {"run.sampling_jitter": 0.5}


def test_with_jitter_the_fmu_is_sampled_at_the_jittered_times(tmp_path):
    file = read(tmp_path, MOVER, SHORT, JITTER)
    clock, times = file.clock, file.scenario.target.times
    assert {clock.t(k) / 1e9 for k in range(11)} <= set(times)
    assert times[-1] == clock.t(10) / 1e9 < 1
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        assert verify(reader, experiment_of(reader), plants=True).difference is None


def test_with_jitter_an_fmu_of_fixed_step_is_refused(tmp_path):
    with ZipFile(build("planar_robot")) as old, ZipFile(tmp_path / "even.fmu", "w") as new:
        for name in old.namelist():
            data = old.read(name).replace(b'canHandleVariableCommunicationStepSize="true"', b"")
            new.writestr(name, data)
    even = MOVER | {"fmu": "even.fmu"}
    with pytest.raises(ScenarioError, match=r"even.fmu: lacks canHandleVariable"):
        read(tmp_path, even, SHORT, JITTER)
    assert read(tmp_path, even, SHORT).scenario.target.times[-1] == 1
