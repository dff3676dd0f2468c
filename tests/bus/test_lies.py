"""What robots send in place of their samples, row by row."""

import numpy as np
import pytest

from nrs_cosim.bus.lies import Lie, Lies
from nrs_cosim.bus.random_streams import keyed_normal

S = 10**9
SENT = {
    "position": np.arange(8.0).reshape(4, 2),
    "velocity": -np.arange(4.0).reshape(4, 1),
}
SOURCE, SINK = np.array([3, 5, 7, 9]), np.array([1, 1, 2, 4])


def lie(kind, number=0, spans=(), **values):
    return Lie(number, kind, {name: np.array(value) for name, value in values.items()}, spans)


def sent_instead(by_row, t=2 * S, k=4, sink=None, pretended=None):
    """Return what is sent, and see to it that what would have been is as it was."""
    before = {name: values.copy() for name, values in SENT.items()}
    lies = Lies(11, by_row, SOURCE, sink)
    found = lies.sent_instead(k, t, SENT, *([pretended] if pretended else []))
    for name, values in before.items():
        assert (SENT[name] == values).all()
    return found


def changed(row, name, value):
    """Return all that is sent with one row of one field changed."""
    expected = {field: values.copy() for field, values in SENT.items()}
    expected[name][row] = value
    return expected


def expect(found, expected):
    assert found.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(found[name], values, strict=True)


@pytest.mark.parametrize(
    ("one", "value"),
    [
        (lie("stuck", position=7.5), 7.5),
        (lie("stuck", position=[7.5, 8.5]), [7.5, 8.5]),
        (lie("offset", position=0.5), [2.5, 3.5]),
        (lie("offset", position=[0.5, -1]), [2.5, 2.0]),
        (lie("ramp", position=0.5), [3.0, 4.0]),
        (lie("ramp", spans=((S // 2, 3 * S),), position=2.0), [5.0, 6.0]),
        (lie("ramp", spans=((0, S), (S, 3 * S)), position=2.0), [4.0, 5.0]),
    ],
)
def test_of_one_row_one_field_is_another(one, value):
    expect(sent_instead([[], [one], [], []]), changed(1, "position", value))


@pytest.mark.parametrize(
    ("spans", "tells"),
    [
        ((), True),
        (((2 * S, 3 * S),), True),
        (((2 * S + 1, 3 * S),), False),
        (((S, 2 * S),), False),
        (((S, 2 * S + 1),), True),
        (((0, S), (S, 2 * S + 1)), True),
        (((0, S), (3 * S, 4 * S)), False),
    ],
)
def test_it_is_told_from_the_first_time_on_and_before_the_last(spans, tells):
    one = lie("stuck", spans=spans, velocity=4.0)
    expect(sent_instead([[], [], [one], []]), changed(2, "velocity", 4.0) if tells else SENT)


def test_since_says_when_it_began():
    assert lie("ramp").since(0) == 0
    assert lie("ramp").since(5 * S) == 0
    spans = ((S, 2 * S), (3 * S, 4 * S))
    began = [lie("ramp", spans=spans).since(t * S // 2) for t in range(9)]
    assert began == [None, None, S, S, None, None, 3 * S, 3 * S, None]


def test_later_ones_are_told_of_what_earlier_ones_say_whatever_their_order_is_in_a_row():
    first, second = lie("stuck", 0, position=1.0), lie("offset", 1, position=0.5)
    expect(sent_instead([[], [second, first], [], []]), changed(1, "position", 1.5))


def test_one_that_is_over_does_not_end_the_others():
    over, one = lie("stuck", 0, ((0, S),), position=1.0), lie("stuck", 1, position=2.0)
    expect(sent_instead([[over], [one], [], []]), changed(1, "position", 2.0))


def test_one_lie_is_told_by_all_that_tell_it():
    one = lie("offset", velocity=1.0)
    found = sent_instead([[one], [], [one], [one]])
    assert found["velocity"].ravel().tolist() == [1, -1, -1, -2]
    assert found["position"] is SENT["position"]


@pytest.mark.parametrize("sink", [None, SINK], ids=["to all", "to one"])
@pytest.mark.parametrize("rows", [(3,), (0, 3)], ids=["of one robot", "of two"])
def test_noise_is_drawn_by_seed_number_field_sender_receiver_and_tick(rows, sink):
    one = lie("noise", 6, position=[2.0, 3.0])
    found = sent_instead([[one] * (row in rows) for row in range(4)], sink=sink)
    for row in rows:
        pair = np.array([(int(SOURCE[row]) << 32) + (0 if sink is None else int(SINK[row]))])
        drawn = keyed_normal(11, "lie 6 position", pair, 4, 2)[0]
        expected = SENT["position"][row] + np.array([2.0, 3.0]) * drawn
        np.testing.assert_array_equal(found["position"][row], expected)
    assert (found["position"][1:3] == SENT["position"][1:3]).all()


def test_what_an_algorithm_says_is_sent_and_nothing_before_it_has_said_anything():
    one, pretended = lie("algorithm", 3), {"position": np.array([5.0, 6.0]), "velocity": [7.0]}
    expected = changed(1, "position", [5.0, 6.0])
    expected["velocity"][1] = 7.0
    expect(sent_instead([[], [one], [], []], pretended={3: pretended}), expected)
    expect(sent_instead([[], [one], [], []], pretended={2: pretended}), SENT)
    expect(sent_instead([[], [one], [], []]), SENT)
