"""An algorithm and its parameters, as they are named in sentences and tables."""

from collections.abc import Mapping
from typing import Any


def with_parameters(name: str, parameters: Mapping[str, Any]) -> str:
    """Return `dcea1 (alpha = 0.9, beta = 1.1)`."""
    given = ", ".join(f"{key} = {_written(value)}" for key, value in parameters.items())
    return f"{name} ({given})" if given else name


def _written(value: Any) -> str:
    """Return a value as TOML has it, a number in as few digits as say it whole."""
    match value:
        case bool():
            return str(value).lower()
        case float():
            return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return repr(value)
