"""Where robots start, from the last checkpoint of each that a recording has."""

import pytest

from nrs_cosim.orchestrator.engine.restart import Point, point_of

AT_6 = {robot: (6, b"robot %d" % robot) for robot in (1, 2, 3)}


def test_robots_restart_at_the_latest_common_checkpoint():
    point = point_of([3, 1], AT_6, 8)
    assert (point.start, point.recorded) == (6, 8)
    assert list(point.checkpoints) == [b"robot 3", b"robot 1"]


@pytest.mark.parametrize(
    "checkpoints",
    [{}, {1: AT_6[1], 2: AT_6[2]}, {**AT_6, 3: (4, b"earlier")}],
    ids=["none has one", "one lacks its own", "one has an earlier one"],
)
@pytest.mark.parametrize("recorded", [-1, 8])
def test_robots_restart_at_the_beginning_without_a_common_checkpoint(checkpoints, recorded):
    point = point_of([1, 2, 3], checkpoints, recorded)
    assert (point.start, point.recorded, list(point.checkpoints)) == (0, recorded, [])


def test_checkpoints_of_other_robots_do_not_matter():
    point = point_of([1, 2], {**AT_6, 3: (4, b"earlier")}, 7)
    assert (point.start, list(point.checkpoints)) == (6, [b"robot 1", b"robot 2"])


def test_without_a_checkpoint_robots_restart_at_the_beginning():
    assert (Point().start, Point().recorded, Point().checkpoints) == (0, -1, ())
