"""How many and which, as a message says it: `1 link`, `robots 1-3, 7`, `a or b`."""

from collections.abc import Iterable, Sequence


def count_of(number: int, what: str) -> str:
    """Return `1 link`, or `2 links`."""
    return f"{number} {plural(what, number)}"


def numbered(what: str, numbers: Sequence[int], most: int | None = None) -> str:
    """Return `robot 7`, or `robots 1-3, 7`; see `spans`."""
    return f"{plural(what, len(numbers))} {spans(numbers, most)}"


def spans(numbers: Sequence[int], most: int | None = None) -> str:
    """Return ascending numbers as `1-3, 7`; with a mark for what is beyond so many spans."""
    found: list[list[int]] = []
    for number in numbers:
        if found and number == found[-1][1] + 1:
            found[-1][1] = number
        else:
            found.append([number, number])
    shown = [f"{first}-{last}" if last > first else f"{first}" for first, last in found[:most]]
    return ", ".join([*shown, *(["…"] if len(shown) < len(found) else [])])


def any_of(names: Iterable[str]) -> str:
    """Return `a, b or c`."""
    *most, last = names
    return f"{', '.join(most)} or {last}" if most else last


def plural(what: str, number: int) -> str:
    """Return the word for so many."""
    return what if number == 1 else f"{what}s"
