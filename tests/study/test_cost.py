"""What a study costs is told by measured times, and what is done once is counted once."""

import pytest

from nrs_cosim.orchestrator.engine.recording_size import BYTES
from nrs_cosim.orchestrator.study.cost import TimedPoint, estimated_cost, time_left

POINTS, TICKS = 100, 300


@pytest.mark.parametrize("count", [2, 3, 5])
def test_the_start_of_the_first_point_is_counted_once(count):
    """A start of 5 s, and 1 ms a tick: 100 points of 300 ticks take 35 s, and not 177 s."""
    timed = [TimedPoint(5.3, TICKS, 900), *[TimedPoint(0.3, TICKS, 900)] * (count - 1)]
    seconds, size = estimated_cost(timed, POINTS * TICKS)
    assert seconds == pytest.approx(35.0)
    assert size == POINTS * 900 * BYTES


def test_points_of_other_lengths_cost_by_their_ticks():
    timed = [TimedPoint(2.1, 100, 100), TimedPoint(0.2, 200, 200), TimedPoint(0.6, 600, 600)]
    assert estimated_cost(timed, 10_000)[0] == pytest.approx(2.0 + 10.0)


def test_a_first_point_that_is_faster_has_no_start():
    timed = [TimedPoint(0.1, TICKS, 0), TimedPoint(0.3, TICKS, 0)]
    assert estimated_cost(timed, POINTS * TICKS)[0] == pytest.approx(30.0)


def test_one_point_is_as_all_others_and_none_cost_nothing():
    assert estimated_cost([TimedPoint(0.5, TICKS, 0)], TICKS)[0] == pytest.approx(0.5)
    assert estimated_cost([], 0.0) == (0.0, 0.0)


def test_the_time_left_goes_by_the_pace_after_the_first_point():
    begun, first = (100.0, 0), (110.0, 300)
    assert time_left([begun, first], 110.0, 300, 600) == pytest.approx(20.0)
    assert time_left([begun, first], 111.0, 600, 300) == pytest.approx(1.0)
