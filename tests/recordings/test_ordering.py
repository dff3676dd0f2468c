"""Messages in any order become columns in total order, against Python's own sort."""

import random

import pytest

from nrs_cosim.recordings.mcap.ordering import columns_of, concatenated, order, ranks

NUMBERS = {"b": 4, "a": 9, "c": 2}
TOPICS = {number: topic for topic, number in NUMBERS.items()}


def in_order(messages):
    """Return messages by (log_time, topic), then sequence, then data."""
    return sorted(messages, key=lambda message: (message[0], *message[1:]))


def through(messages, parts=1):
    """Return messages as columns have them: several parts joined, and put in order."""
    each = -(-len(messages) // parts)
    stretches = [messages[at : at + each] for at in range(0, len(messages), each)]
    columns = concatenated([columns_of(stretch, NUMBERS) for stretch in stretches])
    assert columns.messages(TOPICS) == messages
    return columns.at(order(columns, ranks(TOPICS))).messages(TOPICS)


@pytest.mark.parametrize("parts", [1, 2, 3, 5])
@pytest.mark.parametrize("seed", range(5))
def test_order_is_total(seed, parts):
    rng = random.Random(seed)
    messages = [
        (rng.randrange(3), rng.choice("abc"), rng.randrange(2), rng.randbytes(rng.randrange(3)))
        for _ in range(40)
    ]
    assert through(messages, parts) == in_order(messages)


def test_messages_equal_but_for_data_are_ordered_by_data():
    messages = [(5, "a", 1, data) for data in (b"c", b"", b"b", b"ba", b"a")]
    messages += [(5, "b", 1, b"z"), (5, "b", 1, b"y"), (4, "b", 1, b"x")]
    assert through(messages) == in_order(messages)


def test_a_single_message_is_in_order():
    assert through([(0, "a", 0, b"")]) == [(0, "a", 0, b"")]


@pytest.mark.parametrize("number", [0, 2**64 - 1])
def test_extreme_times_and_sequences_are_ordered(number):
    message = (number, "a", min(number, 2**32 - 1), b"x")
    assert columns_of([message], NUMBERS).messages(TOPICS) == [message]


@pytest.mark.parametrize(
    ("message", "why"),
    [
        ((0, "d", 0, b""), "topic 'd' has no channel"),
        ((-1, "a", 0, b""), "out of range"),
        ((0, "a", -1, b""), "out of range"),
        ((2**64, "a", 0, b""), "out of range"),
        ((0, "a", 2**32, b""), "out of range"),
    ],
)
def test_numbers_that_do_not_fit_are_refused(message, why):
    with pytest.raises(ValueError, match=why):
        columns_of([(0, "a", 0, b""), message], NUMBERS)


def test_topics_rank_by_their_names():
    found = ranks(TOPICS)
    assert [found[NUMBERS[topic]] for topic in "abc"] == [0, 1, 2]
    assert len(ranks({})) == 1
