"""Text that can be stored, sent and shown: UTF-8, of a length, without what steers a terminal.

Python keeps a byte that is no UTF-8 as half of a surrogate pair, which no encoder takes. Where such
a name becomes a part of a record or a message, the byte is written out as `\\\\udcff`.
"""

import re
from collections.abc import Sequence
from unicodedata import category

LONGEST = 80
"""Characters of a value or a name that a message repeats."""
_MARK = " … "
_HEAD = 2 * (LONGEST - len(_MARK)) // 3
_TAIL = LONGEST - len(_MARK) - _HEAD
_TOO_LONG = re.compile(r"[^\s/]{256,}")
"""What is no name in a path, for these have at most 255 bytes."""
_STEERS = {"Cc", "Cf"}
"""Categories of what is not seen: control characters, and those that change the direction."""


def not_utf8(error: UnicodeDecodeError) -> str:
    """Say where bytes are no text in UTF-8, what stands there, and what to do."""
    lines, end, rest = error.object[: error.start].rpartition(b"\n")
    number = (lines + end).count(b"\n") + 1
    column = len(rest.decode("utf-8", "replace")) + 1
    byte = error.object[error.start]
    latin = f", {chr(byte)} in Latin-1" if byte >= 0xA0 else ""
    return (
        f"it is no text in UTF-8: line {number}, column {column} is the byte 0x{byte:02x}{latin}; "
        "save the file as UTF-8"
    )


def storable(text: str) -> str:
    """Return a text with what cannot be encoded as an escape."""
    return text.encode(errors="backslashreplace").decode()


def shortened(text: str) -> str:
    """Return a text on one line of at most `LONGEST` characters, what is left out in its middle."""
    plain = printable(text[: LONGEST + 1] + text[LONGEST + 1 :][-LONGEST:]).replace("\n", "\\n")
    return plain if len(plain) <= LONGEST else f"{plain[:_HEAD]}{_MARK}{plain[-_TAIL:]}"


def quoted(value: object) -> str:
    """Return a value of the user's as a message repeats it: as Python writes it, shortened."""
    return shortened(repr(value))


def bounded(text: str) -> str:
    """Return a message that may hold any name or path: each of a length, nothing steers."""
    return printable(_TOO_LONG.sub(lambda word: shortened(word[0]), text))


def printable(text: str) -> str:
    """Return a text with what would steer a terminal as an escape; lines stay."""
    if text.isprintable():
        return text
    return "".join(
        c.encode("unicode_escape").decode() if c != "\n" and category(c) in _STEERS else c
        for c in text
    )


def nearest(name: str, known: Sequence[str]) -> str:
    """Suggest the nearest known name, or list them all, as the end of a sentence."""
    found = close(name, known)
    return f"; did you mean {found[0]!r}?" if found else f"; there are {', '.join(known)}"


def close(name: str, known: Sequence[str]) -> list[str]:
    """Return the nearest known name, if one is near."""
    from difflib import get_close_matches  # noqa: PLC0415, for what is wrong alone

    return get_close_matches(name, known, n=1)
