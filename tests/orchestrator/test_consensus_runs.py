"""Algorithms that keep more than an estimate run the same wherever their robots do."""

import pytest

from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.scenarios import SCENARIOS

ALGORITHMS = {
    "pi_consensus": "{name='pi_consensus',alpha=0.7,beta=1.0,kappa=0.3}",
    "kalman_consensus": "{name='kalman_consensus',q=1.0,r=1e-4,epsilon=0.5}",
}


def digest(path):
    with Reader(path) as reader:
        assert reader.status == "completed"
        return reader.digest


FILES = ["paper_lossy_links.toml", "paper_first_order.toml"]


@pytest.mark.parametrize("file", cases(FILES, FILES[:1]))
@pytest.mark.parametrize("name", cases([*ALGORITHMS], ["kalman_consensus"]))
def test_three_workers_have_the_digest_of_one_and_a_replay_is_identical(tmp_path, name, file):
    change = f"run.duration=2,algorithm={ALGORITHMS[name]}"
    if name == "kalman_consensus":
        change += ",algorithm.missing=drop"
    for workers in ("1", "3"):
        output = tmp_path / f"{workers}.mcap"
        done = nrs("run", SCENARIOS / file, "--set", change, "-o", output, "--workers", workers)
        assert done.returncode == 0, done.stderr
    assert digest(tmp_path / "1.mcap") == digest(tmp_path / "3.mcap")
    done = nrs("replay", tmp_path / "3.mcap", "--verify")
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("identical")


def test_a_given_initial_agent_state_is_used(tmp_path):
    change = f"run.duration=1,algorithm={ALGORITHMS['pi_consensus']}"
    given = f"{change},initial.integral=[5,-5]"
    for name, text in (("zero", change), ("given", given)):
        done = nrs("run", SCENARIOS / "paper_first_order.toml", "--set", text, "-o",
                   tmp_path / f"{name}.mcap")  # fmt: skip
        assert done.returncode == 0, done.stderr
    assert digest(tmp_path / "zero.mcap") != digest(tmp_path / "given.mcap")
