"""The bus within one process and one thread, without Zenoh: a put is an append to each inbox."""

from collections import deque
from fnmatch import fnmatchcase

from nrs_cosim.bus.transport import Item, Message, Put


class MemoryInbox:
    """A party's inbox on a `MemoryBus`; nothing comes while it waits, so it does not."""

    def __init__(self) -> None:
        self.waiting: deque[Item] = deque()

    def take(self, seconds: float = 0.0) -> list[Item]:  # noqa: ARG002
        """Return all that arrived, in order."""
        taken = list(self.waiting)
        self.waiting.clear()
        return taken


class MemoryBus:
    """A bus for tests and notebooks."""

    def __init__(self) -> None:
        self._listeners: list[tuple[str, MemoryInbox]] = []

    def publisher(self, key: str) -> Put:
        """Declare the right to put on a key."""

        def put(payload: bytes) -> None:
            for pattern, inbox in self._listeners:
                # `*` stands for one part of a key, and that of fnmatch would cross a slash.
                if key.count("/") == pattern.count("/") and fnmatchcase(key, pattern):
                    inbox.waiting.append(Message(key, payload))

        return put

    def listen(self, *patterns: str) -> MemoryInbox:
        """Hear every key that a pattern matches, from now on, in an inbox of its own."""
        inbox = MemoryInbox()
        self._listeners += [(pattern, inbox) for pattern in patterns]
        return inbox

    def close(self) -> None:
        """Forget all listeners."""
        self._listeners.clear()
