"""Numbers that people or programs wrote as text: ASCII decimal digits, a point, an exponent.

Python's own `float` and `int` read more: `1_0`, digits of any script, `nan`, `infinity`. None of
these is a number in a table or on a command line, so none of them is one here.
"""

import re

from nrs_cosim.bus.text import quoted

_WHOLE = re.compile(r"[+-]?[0-9]{1,18}")
_DECIMAL = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


def whole(text: str) -> int:
    """Return the whole number that a text is, blanks around it aside; `ValueError` for another."""
    if not _WHOLE.fullmatch(text.strip(" \t\r\n")):
        raise ValueError(f"{quoted(text)} is no whole number")
    return int(text)


def decimal(text: str) -> float:
    """Return the double nearest to a decimal number, infinite when it is too large for one.

    Blanks around it are passed over; `ValueError` for any other text.
    """
    if not _DECIMAL.fullmatch(text.strip(" \t\r\n")):
        raise ValueError(f"{quoted(text)} is no decimal number")
    return float(text)
