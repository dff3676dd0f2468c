"""What is left of a beginning is no breach of a bound, also where no steady motion is known."""

import pytest

from nrs_cosim.orchestrator.analysis.comparison import compare_to_theory
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import measure
from nrs_cosim.recordings.mcap.reader import Reader
from tests.scenarios import paper

AT_REST = {"position": 0.0, "velocity": 1.0, "q": 0.0, "qd": 1.0}
IMPULSIVE = {"name": "impulsive", "alpha": 0.8, "beta": 0.5}
LATE = {"name": "dcea2", "alpha": 1.1, "beta": 0.9}
STRAIGHT = {"axes": [{"rate": 1.0}] * 2}
SAMPLED = {
    "kind": "sampled",
    "times": [0.0, 15.0, 40.0],
    "positions": [[t, t] for t in (0, 15, 40)],
}


def compared(folder, target, algorithm, **changes):
    given = {"target": target, "algorithm": algorithm, "initial": AT_REST, "disturbance": None}
    experiment = paper({"run.duration": 5.0, **given, **changes})
    with Reader(run(experiment, folder / "run.mcap").path) as reader:
        return compare_to_theory(reader, experiment, measure(reader, experiment)).quantities


def test_of_agents_that_lag_behind_a_sampled_target_as_much_is_left_as_of_its_formula(tmp_path):
    """The samples lie on a straight line, so that both are the same motion."""
    drawn = compared(tmp_path, SAMPLED, IMPULSIVE)
    formula = compared(tmp_path, STRAIGHT, IMPULSIVE)
    for one, same in zip(drawn, formula, strict=True):
        assert one.measured == pytest.approx(same.measured, rel=1e-9, abs=1e-12)
    left = ([row.transient for row in rows[:2]] for rows in (drawn, formula))
    assert next(left) == pytest.approx(next(left), rel=1e-9)
    velocity = drawn[1]
    assert velocity.measured > 100 * velocity.bound.worst_case
    assert velocity.status == "transient"


@pytest.mark.parametrize("delay", [1, 5])
def test_what_is_under_way_from_a_sampled_target_is_not_known(tmp_path, delay):
    rows = compared(tmp_path, SAMPLED, LATE, **{"faults.links": [{"delay": delay}]})
    assert {row.status for row in rows} == {"unproven"}
