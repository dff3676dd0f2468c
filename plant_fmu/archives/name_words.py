"""The words of a variable's name, and which quantity some of them say that it is.

Words end at whatever is no letter, and before a capital or a digit. Of what may be a quantity the
longest counts, then what is spelled out, then the last: `torque_sensor_angle` is an angle.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from typing import Literal

Causality = Literal["input", "moving"]
"""What is set, and what may move though nothing is set."""
Words = tuple[str, ...]

_WORD = re.compile(r"\d+|[A-Z]+(?![a-z])|[^\W\d_][^\W\d_A-Z]*")
_ANGLE = "q|phi|theta|angle|ang|pos|position|displacement|s|x"
_RATE = f"w|omega|v|vel|velocity|speed|rate|qd|dq|d_?(?:{_ANGLE})|(?:{_ANGLE})_?(?:d|dot|rate)"
_WANTED = "ref|reference|set|setpoint|des|desired|cmd|command"


def _wanted(of: str) -> str:
    return f"(?:{of})_?(?:{_WANTED})|(?:{_WANTED})_(?:{of})"


_QUANTITIES: dict[Causality, dict[str, str]] = {
    "moving": {
        "q": _ANGLE,
        "qd": f"{_RATE}|der_(?:{_ANGLE})",
        "acceleration": f"a|acc|acceleration|alpha|qdd|ddq|der_(?:{_RATE})|(?:{_RATE})_?(?:d|dot)",
        "tau": "tau|torque|trq|force|effort|moment",
        "position_ref": _wanted(_ANGLE),
        "velocity_ref": _wanted(_RATE),
    },
    "input": {
        "tau": "tau|torque|trq|u|f|force|effort|moment|m",
        "position_ref": f"{_wanted(_ANGLE)}|(?:{_ANGLE})_?d",
        "velocity_ref": f"{_wanted(_RATE)}|(?:qd|dq|w|omega|v|vel|velocity|speed)_?d",
    },
}
"""Of which words each quantity may be, joined by `_`; that of an acceleration is none of ours."""
_LONGEST = 3


def words_of(name: str) -> Words:
    """Return a name's words in lower case; numbers are words."""
    return tuple(word.lower() for word in _WORD.findall(name))


@lru_cache(maxsize=65536)
def said(words: Words, causality: Causality) -> tuple[str, Words]:
    """Return the quantity that words say, empty where they say none, and the words without it.

    Numbers and empty words are no part of what says it, and stay.
    """
    spelled = [i for i, word in enumerate(words) if word and not word.isdigit()]
    best = max(_runs(tuple(words[i] for i in spelled), causality), default=None)
    if best is None:
        return "", words
    *_, last, length, ours = best
    said_by = set(spelled[last - length + 1 : last + 1])
    return ours, tuple(word for i, word in enumerate(words) if i not in said_by)


def _runs(words: Words, causality: Causality) -> Iterator[tuple[int, bool, int, int, str]]:
    """Yield what runs of words say: how many, whether spelled out, the last, how many, and what."""
    for first in range(len(words)):
        for length in range(1, min(_LONGEST, len(words) - first) + 1):
            text = "_".join(words[first : first + length])
            if ours := _quantity(text, causality):
                yield length, len(text) > 1, first + length - 1, length, ours


@lru_cache(maxsize=65536)
def _quantity(text: str, causality: Causality) -> str:
    return next((o for o, words in _QUANTITIES[causality].items() if re.fullmatch(words, text)), "")
