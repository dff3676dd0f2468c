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
def test_a_value_of_80_characters_is_whole(size):
    assert quoted("k" * size) == repr("k" * size)


def test_a_value_of_81_characters_is_shortened():
    assert len(quoted("k" * 79)) == LONGEST
    assert " … " in quoted("k" * 79)


def test_what_steers_a_terminal_is_an_escape_and_lines_and_letters_stay():
    assert printable("a\x1b[31m\x07\u202eé\nß\udcff") == "a\\x1b[31m\\x07\\u202eé\nß\udcff"
    assert shortened("a\nb\x1b") == "a\\nb\\x1b"


def test_of_a_message_only_words_that_no_file_can_have_are_shortened():
    path = "/tmp/" + "k" * 250
    assert bounded(f"{path}: no such file") == f"{path}: no such file"
    assert len(bounded(f"{'k' * 5000} is no file")) == LONGEST + len(" is no file")
