"""Every command prints what its snapshot has, word by word; see tests/printed.py."""

import pytest

from tests.orchestrator.networks import phases
from tests.printed import SNAPSHOTS, session
from tests.scenarios import SHORT, write

PATH = {"network": {"generator": {"kind": "path", "n": 30}}}
GAINS = ("algorithm.alpha", "algorithm.beta")
CHECKS = {
    "check": ("paper_first_order", {}),
    "check_second_order": ("paper_example_3a", {}),
    "check_outside_the_bound": ("paper_example_1c", {}),
    "check_negative_bound": ("paper_example_3a", {"algorithm.beta": 1.9}),
    "check_link_faults": ("paper_lossy_links", {}),
    "check_link_faults_diverging": ("paper_lossy_links", {"algorithm.alpha": 5}),
    "check_delay": (
        "paper_example_3a",
        {"run.sampling_period": 0.4, "faults.links": [{"delay": 1}]},
    ),
    "check_jitter": ("paper_jitter", {}),
    "check_switching": ("switching", {}),
    "check_switching_paths": (
        "paper_first_order",
        {"network": phases((1, PATH["network"]), (5, PATH["network"])), **SHORT},
    ),
    "check_separate_networks": ("hetero_information", {}),
    "check_path": ("paper_first_order", PATH | dict.fromkeys(GAINS, 0.9)),
    "check_path_gains_of_1": ("paper_first_order", PATH | dict.fromkeys(GAINS, 1.0)),
    "check_two_robots": (
        "paper_first_order",
        {"network": {"edge_list": [[0, 1], [2, 1], [1, 2]]}},
    ),
    "check_own_controller": (
        "paper_first_order",
        {"robots": [{"id": 3, "controller": {"kp": 25.0, "kd": 300.0}}]},
    ),
    "check_unknown_fmu": ("paper_first_order", {"plant.fmu": "none.fmu"}),
}


@pytest.mark.parametrize("name", CHECKS)
def test_check_prints_its_snapshot(tmp_path, snapshot, name):
    base, changes = CHECKS[name]
    write(tmp_path / "s.toml", changes, base=base)
    snapshot(name, session(tmp_path, "check s.toml"))


def test_designs_print_their_snapshot(tmp_path, snapshot):
    write(tmp_path / "first.toml")
    write(tmp_path / "second.toml", base="paper_example_3a")
    snapshot(
        "design",
        session(
            tmp_path,
            "design first.toml --accuracy 0.5 0.5",
            "design second.toml --fastest",
            "design second.toml --period",
            "design second.toml --pin 2",
        ),
    )


def test_a_run_and_its_recording_print_their_snapshot(tmp_path, snapshot):
    write(tmp_path / "short.toml", SHORT)
    write(tmp_path / "other.toml", SHORT, {"algorithm.alpha": 0.8})
    snapshot(
        "run",
        session(
            tmp_path,
            "run short.toml -o run.mcap",
            "info run.mcap",
            "replay run.mcap --verify",
            "run other.toml -o other.mcap",
            "diff run.mcap other.mcap",
            "diff run.mcap run.mcap",
        ),
    )


def test_a_failed_run_prints_its_snapshot(tmp_path, snapshot):
    write(tmp_path / "s.toml", {"run.divergence_limit": 500.0}, base="paper_example_1c")
    snapshot("run_failed", session(tmp_path, "run s.toml -o run.mcap", "info run.mcap"))


def test_a_run_with_link_faults_prints_its_snapshot(tmp_path, snapshot):
    write(tmp_path / "s.toml", SHORT, base="paper_lossy_links")
    snapshot("run_link_faults", session(tmp_path, "run s.toml -o run.mcap"))


def test_fmu_commands_print_their_snapshot(tmp_path, snapshot):
    snapshot(
        "fmu",
        session(tmp_path, "fmu list", "fmu info two_link_arm", "fmu check two_link_arm"),
    )


def test_every_snapshot_is_that_of_a_test():
    others = {"design", "comparison", "fmu", "run", "run_failed", "run_link_faults"}
    assert {path.stem for path in SNAPSHOTS.iterdir()} == CHECKS.keys() | others
