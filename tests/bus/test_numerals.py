"""Text is a number where ASCII decimal digits make one, and nowhere else."""

import pytest

from nrs_cosim.bus.numerals import decimal, whole


@pytest.mark.parametrize(
    ("text", "number"),
    [("1", 1), ("-2.5", -2.5), ("+.5", 0.5), ("1.", 1), (" 1e-3\r\n", 1e-3), ("2E5", 2e5)],
)
def test_a_decimal_number_is_the_double_next_to_it(text, number):
    assert decimal(text) == number


@pytest.mark.parametrize(
    "text",
    ["", " ", ".", "e3", "1_0", "١", "1٫5", "nan", "inf", "Infinity", "0x10", "1,5", "1 0", "−1"],
)
def test_number_forms_that_only_python_reads_are_refused(text):
    for reading in (decimal, whole):
        with pytest.raises(ValueError, match="is no"):
            reading(text)


@pytest.mark.parametrize("text", ["1.0", "1e3", "9" * 5000])
def test_a_whole_number_has_neither_point_nor_exponent_nor_thousands_of_digits(text):
    with pytest.raises(ValueError, match="is no whole number"):
        whole(text)


def test_a_whole_number_is_read_as_itself():
    assert [whole(text) for text in ("0", " 07 ", "+3", "-12")] == [0, 7, 3, -12]
