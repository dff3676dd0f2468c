"""Robots lie to the same bits on any workers, and after these have died."""

import pytest

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.cluster.local_workers import CHECKPOINTS, LocalRun, digest, story
from tests.scenarios import example, paper

pytestmark = pytest.mark.usefixtures("nothing_is_left")

OTHER = {"name": "pi_consensus", "alpha": 0.7, "beta": 0.9, "kappa": 0.3}
LIES = {
    "faults.byzantine": [
        {"robot": 4, "kind": "algorithm", "algorithm": OTHER | {"kappa": 0.1}},
        {"robot": 1, "kind": "noise", "value": {"position": 0.5}},
        {"robot": 2, "kind": "stuck", "times": [[4.0, 8.0]]},
        {"robot": 4, "kind": "ramp", "value": 0.1, "times": [[5.0, 14.0]]},
        {"robot": 3, "kind": "noise", "value": 2.0, "to": [1, 4]},
        {"robot": 3, "kind": "offset", "value": -3.0, "to": [4, 5]},
        # What 1 tells 4 follows from what 2 tells 1, wherever these are.
        {"robot": 2, "kind": "algorithm", "algorithm": OTHER, "to": [1, 5]},
        {"robot": 1, "kind": "algorithm", "algorithm": OTHER, "to": [4]},
    ]
}
OF_ALL = (CHECKPOINTS, LIES, {"run.duration": 15.0})
WMSR = {"algorithm": {"name": "wmsr", "F": 1, "missing": "hold"}}
TRIGGERED = {
    "algorithm": {"name": "event_triggered", "alpha": 0.7, "beta": 0.7, "c0": 0.3, "d0": 0.3},
}


MADE = ("links with faults", "triggered", "sound links")


@pytest.mark.parametrize("made", cases(MADE, MADE[:1]))
def test_one_digest_over_workers_and_deaths_which_a_replay_comes_to(tmp_path, made):
    experiment = {
        "links with faults": lambda: example("paper_lossy_links", *OF_ALL),
        "sound links": lambda: paper(WMSR, *OF_ALL),
        "triggered": lambda: paper(TRIGGERED, *OF_ALL),
    }[made]()
    path = tmp_path / "1.mcap"
    run(experiment, path)
    outcome = LocalRun(experiment, 3).kill(30, 1).kill(70, 2, 3).run(tmp_path / "3.mcap")
    assert (outcome.status, outcome.restarts) == ("completed", 3)
    assert story(outcome.path) == story(path)
    assert digest(outcome.path) == digest(path)
    with Reader(outcome.path) as reader:
        assert verify(reader, experiment, plants=True).status == "identical"
        assert verify(reader, experiment, plants=False).status == "identical"
