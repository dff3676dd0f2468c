"""What is wrong with a text that is not TOML: line, column, the character, and what to write.

The usual causes are characters that a word processor, a web page or a language puts in place of
those of a keyboard: curly quotes, a minus that is a character of its own, a decimal comma. They are
looked for outside of strings and comments of the line where the parser stopped; the rest is said in
the parser's own words.
"""

import re
from unicodedata import name, normalize

from nrs_cosim.bus.text import quoted

_TWICE = ("Cannot overwrite", "Cannot declare", "Duplicate inline", "Cannot mutate")
"""How tomllib begins where a key or a table is given a second time."""
_FOR = dict.fromkeys("“”„‟«»″＂", '"') | dict.fromkeys("‘’‚‛′", "'") | dict.fromkeys("−–—‐‑‒", "-")
"""What to write for characters that only look like those of TOML."""
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"|\'[^\']*\'')
_COMMA = re.compile(r"=\s*([+-]?\d+),(\d+)\s*$")
_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


def wrong_toml(text: str, cause: str) -> str:
    """Return what is wrong with a text, of which tomllib gives a cause."""
    lines = text.splitlines() or [""]
    at = _PLACE.search(cause)
    number = min(int(at[1]) if at and at[1] else len(lines), len(lines))
    while number > 1 and not lines[number - 1].strip():
        number -= 1
    line = lines[number - 1]
    if cause.startswith(_TWICE):
        return f"line {number}: {quoted(line.strip())} gives a key a second time; keep one"
    code = _code(line)
    if comma := _COMMA.search(code):
        given, meant = f"{comma[1]},{comma[2]}", f"{comma[1]}.{comma[2]}"
        return f"line {number}, column {comma.start(1) + 1}: got {given}; write {meant}"
    for column, character in enumerate(code, 1):
        if character > "\x7f":
            return (
                f"line {number}, column {column}: got {quoted(character)} "
                f"(U+{ord(character):04X} {name(character, 'without a name')}); {_meant(character)}"
            )
    return f"not valid TOML: {cause}"


def _code(line: str) -> str:
    """Return a line with blanks in place of its strings, and without its comment."""
    plain = _STRING.sub(lambda found: " " * len(found[0]), line)
    return plain.partition("#")[0]


def _meant(character: str) -> str:
    """Say what to write for a character that TOML has no use for outside of strings."""
    meant = _FOR.get(character) or normalize("NFKC", character)
    if meant == " ":
        return "write a blank"
    if meant.isascii() and meant.isprintable() and meant:
        return f"write {meant}"
    return "leave it out, or put what it is part of in quotes"
