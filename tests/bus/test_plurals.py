"""A message says how many there are, and which."""

import pytest

from nrs_cosim.bus.plurals import count_of, numbered, spans


@pytest.mark.parametrize(("number", "said"), [(0, "0 links"), (1, "1 link"), (2, "2 links")])
def test_a_count_of_one_is_singular(number, said):
    assert count_of(number, "link") == said


@pytest.mark.parametrize(
    ("numbers", "said"),
    [
        ([7], "robot 7"),
        ([1, 2], "robots 1-2"),
        ((1, 2, 3, 7), "robots 1-3, 7"),
        (range(1, 7), "robots 1-6"),
        ([1, 3, 5], "robots 1, 3, 5"),
    ],
)
def test_numbers_one_after_the_other_are_a_span(numbers, said):
    assert numbered("robot", numbers) == said


def test_beyond_so_many_spans_there_is_a_mark():
    odd = range(1, 20, 2)
    assert spans(odd, 3) == "1, 3, 5, …"
    assert spans(odd, 10) == spans(odd)
    assert spans([*range(1, 100), 200], 1) == "1-99, …"
