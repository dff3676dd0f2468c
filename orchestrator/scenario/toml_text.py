"""Tables as a text in TOML that reads back the same: a line for each key, inner tables in braces.

It keeps no comments and no layout, for which tomlkit is there, and takes a tenth of its time.
"""

import json
import re
from collections.abc import Mapping
from typing import Any

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_DELETE = "\x7f"
"""The one character that JSON has as it is, and TOML does not."""


def toml_text(tables: Mapping[str, Any]) -> str:
    """Return tables as a text; values are those that TOML has."""
    lines = [_line(key, value) for key, value in tables.items() if not isinstance(value, Mapping)]
    for key, table in tables.items():
        if isinstance(table, Mapping):
            lines += [f"\n[{_key(key)}]", *(_line(name, value) for name, value in table.items())]
    return "\n".join(lines).lstrip() + "\n"


def _line(key: str, value: Any) -> str:
    return f"{_key(key)} = {_value(value)}"


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else _value(key)


def _value(value: Any) -> str:
    match value:
        case str():
            return json.dumps(value, ensure_ascii=False).replace(_DELETE, "\\u007f")
        case bool():
            return "true" if value else "false"
        case int() | float():
            return repr(value)
        case Mapping():
            return "{" + ", ".join(_line(name, inner) for name, inner in value.items()) + "}"
        case list() | tuple():
            return "[" + ", ".join(map(_value, value)) + "]"
        case _:  # a date or a time
            return str(value.isoformat())
