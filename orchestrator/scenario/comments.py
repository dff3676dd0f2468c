"""Comments of a scenario speak of its values, and go with them.

A value that is set or taken out has its comments beside it and in the lines above it; where a key
comes or goes, so does what is said of its table, beside the header.
"""

from collections.abc import Iterable
from textwrap import wrap
from typing import Any

from tomlkit import TOMLDocument
from tomlkit.items import Comment, Item, Null, Table

WIDTH = 100


def drop_comments(table: Any, name: str) -> None:
    """Take out what is said of a key of a table, which is to have another value."""
    if not isinstance(table, TOMLDocument | Table):  # what has no lines has no comments
        return
    body = (table.value if isinstance(table, Table) else table).body
    places = [i for i, (key, _) in enumerate(body) if key is not None and key.key == name]
    for place in places:
        _silence(body[place][1])
        above = place - 1
        while above >= 0 and isinstance(body[above][1], Comment):
            body[above] = (None, Null())
            above -= 1
    if not places and isinstance(table, Table):
        _silence(table)


def _silence(item: Item) -> None:
    item.trivia.comment = item.trivia.comment_ws = ""


def with_head(text: str, lines: Iterable[str]) -> str:
    """Return a scenario's text with other lines at its top, as comments."""
    kept = text.splitlines(keepends=True)
    while kept and (not kept[0].strip() or kept[0].startswith("#")):
        del kept[0]
    head = [part for line in lines for part in wrap(line, WIDTH - 2, subsequent_indent="  ")]
    return "".join(f"# {line}\n" for line in head) + "\n" + "".join(kept)
