"""A bus carries bytes from a key to all who listen on it, in order, and drops nothing."""

from collections.abc import Callable
from typing import Protocol

Put = Callable[[bytes], None]
"""Puts one message on the key that it was made for."""


class Inbox(Protocol):
    """What arrived on one subscription and was not yet taken."""

    def take(self) -> list[tuple[str, bytes]]:
        """Return (key, payload) of all that arrived, in order, and forget it."""


class Bus(Protocol):
    """A session on the bus. Key patterns follow Zenoh: `*` stands for one part of a key."""

    def publisher(self, key: str) -> Put:
        """Declare the right to put on a key."""

    def listen(self, pattern: str) -> Inbox:
        """Hear every key that the pattern matches, from now on."""

    def close(self) -> None:
        """End the session; its publishers and inboxes are void from now on."""
