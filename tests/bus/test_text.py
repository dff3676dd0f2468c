"""What a message repeats of the user's input: at most 80 characters, and nothing that steers."""

import pytest

from nrs_cosim.bus.text import LONGEST, bounded, printable, quoted, shortened


@pytest.mark.parametrize("value", ["k" * 5000, ["k" * 50] * 50, {"k" * 5000: 1}, 10**90])
def test_a_long_value_keeps_its_beginning_and_its_end(value):
    text = quoted(value)
    assert len(text) == LONGEST
    head, tail = text.split(" … ")
    assert repr(value).startswith(head)
    assert repr(value).endswith(tail)


@pytest.mark.parametrize("size", [0, 1, 77, 78])
def test_a_value_of_80_characters_is_not_shortened(size):
    assert quoted("k" * size) == repr("k" * size)


def test_a_value_of_81_characters_is_shortened():
    assert len(quoted("k" * 79)) == LONGEST
    assert " … " in quoted("k" * 79)


def test_control_characters_are_escaped_but_not_line_breaks_and_letters():
    assert printable("a\x1b[31m\x07\u202eé\nß\udcff") == "a\\x1b[31m\\x07\\u202eé\nß\udcff"
    assert shortened("a\nb\x1b") == "a\\nb\\x1b"


def test_only_words_longer_than_any_file_name_are_shortened_in_a_message():
    path = "/tmp/" + "k" * 250
    assert bounded(f"{path}: no such file") == f"{path}: no such file"
    assert len(bounded(f"{'k' * 5000} is no file")) == LONGEST + len(" is no file")
