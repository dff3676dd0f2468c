"""The scenario of the worst target, run for real, comes to what `nrs check` bounds."""

import numpy as np
import pytest

import nrs_cosim
from nrs_cosim.bus.errors import InputError
from tests.command import nrs
from tests.scenarios import PAPER_FILE, SCENARIOS, write

ESTIMATES = ("|eps - eps_0|inf", "|ups - ups_0|inf")


def measured(recording):
    errors = recording.errors()
    assert np.allclose(errors["position_estimate"][0], 0.0, atol=1e-9)
    assert np.allclose(errors["velocity_estimate"][0], 0.0, atol=1e-9)
    last = errors["t"] >= 0.8 * errors["t"].max()
    return [abs(errors[name][last]).max() for name in ("position_estimate", "velocity_estimate")]


RING = {"kind": "ring", "n": 8, "pinned": [1]}
FAST = {"axes": [{"sines": [{"amplitude": 1.0, "frequency": 14.0}]}] * 2}
CASES = {
    **{name: (name, {}) for name in ("paper_example_1a", "paper_example_2c", "compare_impulsive")},
    # Positions are worst by 4 periods of the past, velocities by 440.
    "a fast target round a ring": (
        "paper_first_order",
        {
            "network": {"generator": RING},
            "target": FAST,
            "initial": None,
            "robots": [],
            "disturbance": None,
            "algorithm.beta": 1.0,
            "run.output_step": None,
        },
    ),
}


@pytest.mark.parametrize(("base", "changes"), CASES.values(), ids=CASES)
def test_a_run_with_the_worst_target_comes_to_98_percent_of_the_worst_case(tmp_path, base, changes):
    theory = nrs_cosim.check(
        nrs_cosim.Scenario.load(write(tmp_path / "s.toml", changes, base=base))
    )
    with nrs_cosim.run(theory.worst_target(), tmp_path / "worst.mcap") as recording:
        found = measured(recording)
    for bound, most in zip(theory.bounds[:2], found, strict=True):
        assert bound.name in ESTIMATES
        assert 0.98 * bound.worst_case <= most <= bound.worst_case * (1 + 1e-5)


def test_a_scenario_with_the_worst_target_is_written_once_and_is_a_scenario(tmp_path):
    output = tmp_path / "worst.toml"
    done = nrs("check", PAPER_FILE, "--worst-target", "-o", output)
    assert done.returncode == 0, done.stderr
    worst = nrs_cosim.Scenario.load(output)
    assert worst["target.kind"] == "sampled"
    assert worst.robots == 6
    assert output.read_text("utf-8").startswith(
        "# 'paper_first_order' with the target of nrs check"
    )
    again = nrs("check", PAPER_FILE, "--worst-target", "-o", output)
    assert again.returncode == 2
    assert "is there already" in again.stderr


def test_of_links_with_faults_no_target_is_said_to_be_the_worst(tmp_path):
    lossy = SCENARIOS / "paper_lossy_links.toml"
    done = nrs("check", lossy, "--worst-target", "-o", tmp_path / "worst.toml")
    assert done.returncode == 2
    assert "no target is known that attains the worst case" in done.stderr
    assert not (tmp_path / "worst.toml").exists()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"algorithm": {"name": "dcea3", "alpha": 0.9, "beta": 1.0, "gamma": 0.9}}, "agents keep"),
        ({"faults.links": [{"delay": 1}]}, "samples are late"),
        ({"run.sampling_jitter": 0.2}, "sampling periods are not constant"),
    ],
)
def test_why_no_target_is_known_is_said(changes, why):
    theory = nrs_cosim.check(nrs_cosim.Scenario.load(PAPER_FILE).replace(changes))
    with pytest.raises(InputError, match=f"attains the worst case: {why}"):
        theory.worst_target()


def test_a_changed_scenario_stays_beside_the_files_that_it_names(tmp_path):
    (tmp_path / "edges.csv").write_text("source,sink,weight\n0,1,1\n1,2,1\n")
    changes = {"network": {"edges": "edges.csv"}}
    path = write(tmp_path / "named.toml", changes)
    done = nrs("check", path, "--worst-target", "-o", tmp_path / "other" / "worst.toml")
    assert done.returncode == 2
    assert "give a name in that folder" in done.stderr
    assert nrs("check", path, "--worst-target", "-o", tmp_path / "worst.toml").returncode == 0
