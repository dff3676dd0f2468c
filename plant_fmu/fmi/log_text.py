"""What an FMU logs is a text, whatever its version of FMI."""

from collections.abc import Callable

Log = Callable[[str], None]


def text_of(message: bytes | None) -> str:
    """Return what an FMU said, in whatever encoding."""
    return (message or b"").decode("utf-8", "replace").strip()
