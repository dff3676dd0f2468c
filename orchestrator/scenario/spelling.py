"""Names that are not known are named with the nearest that is."""

from collections.abc import Sequence
from difflib import get_close_matches


def nearest(name: str, known: Sequence[str]) -> str:
    """Suggest the nearest known name, or list them all."""
    found = close(name, known)
    return f"; did you mean {found[0]!r}?" if found else f"; there are {', '.join(known)}"


def close(name: str, known: Sequence[str]) -> list[str]:
    """Return the nearest known name, if one is near."""
    return get_close_matches(name, known, n=1)
