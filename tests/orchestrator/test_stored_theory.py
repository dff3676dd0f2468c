"""What a run stores of the theory is what is computed of it, and is not trusted beyond that."""

import json
import resource
import subprocess
import sys

import pytest

from nrs_cosim.orchestrator.analysis import results
from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.analysis.results import Result, theory_beside, wrong_theory
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of, measure
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import THEORY
from nrs_cosim.recordings.theory_record import TheoryRecord
from tests.command import nrs
from tests.orchestrator.test_resealed import Sealed
from tests.scenarios import SHORT, example, paper, write

NOISY = {"faults.links": [{"noise": 0.01}]}
LOSSY = {"faults.links": [{"loss": 0.1}]}
LIE, WRONG = {"spectral_radius": 0.5}, "theory: is not what the scenario and the messages give"
LOADS = """import sys
from nrs_cosim.orchestrator.__main__ import main
sys.argv = ["nrs", "info", sys.argv[1]]
try:
    main()
finally:
    print(*sys.modules)
"""


@pytest.mark.parametrize(
    "changes", [{}, NOISY, LOSSY], ids=["sound links", "noise", "lost samples"]
)
def test_what_is_stored_is_what_was_computed(tmp_path, changes):
    experiment = example("paper_first_order", {"run.duration": 6.0, **changes})
    path = run(
        experiment, tmp_path / "run.mcap", more=lambda at: theory_beside(at, experiment)
    ).path
    with Reader(path) as reader:
        computed = compare_to_theory(reader, experiment, measure(reader, experiment)).as_json()
        shown = Result.of(reader, experiment).theory
        assert reader.ending.theory is not None
        assert shown == json.loads(json.dumps(computed))


def test_info_of_a_run_computes_no_theory_and_so_does_that_of_one_that_was_resumed(tmp_path):
    scenario = write(tmp_path / "s.toml", {"run.duration": 1.0})
    assert nrs("run", scenario, "-o", tmp_path / "run.mcap").returncode == 0
    longer = ("--set", "run.duration=1.5", "-o", tmp_path / "longer.mcap")
    assert nrs("resume", tmp_path / "run.mcap", *longer).returncode == 0
    for path in (tmp_path / "run.mcap", tmp_path / "longer.mcap"):
        done = subprocess.run(
            [sys.executable, "-c", LOADS, path], capture_output=True, text=True, check=True
        )
        *said, loaded = done.stdout.splitlines()
        assert any(line.startswith("rho") for line in said)
        names = {*loaded.split()}
        assert not {"scipy", "fmpy", "nrs_cosim.orchestrator.analysis.comparison"} & names
        stored, computed = (
            json.loads(nrs("info", path, "--json", *option).stdout)["theory"]
            for option in ((), ("--verify",))
        )
        assert stored == computed


def test_a_lie_is_seen_through_and_what_is_of_another_run_or_version_is_computed(tmp_path):
    scenario = write(tmp_path / "s.toml", SHORT)
    assert nrs("run", scenario, "-o", tmp_path / "run.mcap").returncode == 0
    honest = Sealed(tmp_path / "run.mcap")

    def lie(end, **more):
        return {**end, THEORY: json.dumps({**json.loads(end[THEORY]), **(LIE | more)})}

    def radius(path):
        with Reader(path) as reader:
            return Result.of(reader, experiment_of(reader)).theory["spectral_radius"]

    liar = honest.again(tmp_path / "liar.mcap", ending=lie)
    other = honest.again(tmp_path / "other.mcap", ending=lambda end: lie(end, of="0" * 64))
    later = honest.again(tmp_path / "later.mcap", ending=lambda end: {**end, THEORY: '{"v": 3}'})
    assert (radius(liar), radius(other)) == (0.5, radius(honest.path))
    assert radius(later) == radius(honest.path)
    asked = json.loads(nrs("info", liar, "--json", "--verify").stdout)
    assert asked["damage"] == [f"nrs.end: {WRONG}"]
    assert asked["theory"]["spectral_radius"] == radius(honest.path)
    verified = nrs("replay", liar, "--verify", "--agents-only")
    assert (verified.returncode, WRONG in verified.stdout + verified.stderr) == (1, True)
    refused = honest.again(tmp_path / "bad.mcap", ending=lambda end: lie(end, quantities=3))
    done = nrs("info", refused)
    assert done.returncode == 2
    assert done.stderr.startswith(f"error: {refused}: nrs.end: theory: quantities: ")


def test_where_its_algorithm_is_not_installed_nothing_is_held_against_what_is_stored(
    tmp_path, monkeypatch
):
    experiment, path = paper(SHORT), tmp_path / "run.mcap"
    run(experiment, path, more=lambda at: theory_beside(at, experiment))
    other = {"why_not": "its algorithm is not installed"}
    with Reader(path, verify=True) as reader:
        assert WRONG in wrong_theory(reader, experiment, other)
        monkeypatch.setattr(results, "NotInstalled", type(experiment.scenario.algorithm))
        assert wrong_theory(reader, experiment, other) == ""


@pytest.mark.parametrize("wrong", [{"spectral_radius": "NaN"}, {"quantities": 3}, {"why_not": []}])
def test_what_is_no_such_record_is_named(wrong):
    whole = {
        "of": "0" * 64,
        "why_not": "",
        "quantities": [],
        **dict.fromkeys(
            ("spectral_radius", "measured_radius", "transient", "steady_since", "noise")
        ),
        "untracked": "",
        "mean_squares": [],
    }
    shown = TheoryRecord.model_validate(whole).as_json()
    assert {**shown, "of": whole["of"]} == whole
    with pytest.raises(ValueError, match=next(iter(wrong))):
        TheoryRecord.model_validate(whole | wrong)


def test_a_run_is_whole_before_and_where_there_is_no_room_for_more(tmp_path):
    experiment, path = paper(SHORT), tmp_path / "run.mcap"
    before = resource.getrlimit(resource.RLIMIT_FSIZE)

    def twice_interrupted(_path):
        raise KeyboardInterrupt

    def beyond_the_room(at):
        with Reader(at) as reader:
            assert reader.status == "completed"
        resource.setrlimit(resource.RLIMIT_FSIZE, (at.stat().st_size, before[1]))
        return {THEORY: "0" * 100}

    with pytest.raises(KeyboardInterrupt):
        run(experiment, path, more=twice_interrupted)
    with Reader(path, verify=True) as reader:
        assert (reader.status, reader.damage) == ("completed", [])
        digest = reader.digest
    try:
        outcome = run(experiment, path, more=beyond_the_room)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert outcome.status == "completed"
    with Reader(path, verify=True) as reader:
        assert (reader.digest, reader.damage, reader.ending.theory) == (digest, [], None)
