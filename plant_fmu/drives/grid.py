"""A span of time in equal parts, none longer than asked; their ends are start + j · part."""

from math import ceil

ROUNDING = 1e-9


def parts(span: float, longest: float) -> int:
    """Return into how many equal parts a span is cut; one a hair longer than asked is let be."""
    return max(1, ceil(span / longest - ROUNDING))
