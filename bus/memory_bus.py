"""The bus within one process and one thread, without Zenoh: a put is an append to each inbox."""

from collections import deque
from fnmatch import fnmatchcase

from bus.transport import Put


class MemoryInbox:
    """A subscription on a `MemoryBus`."""

    def __init__(self) -> None:
        self.waiting: deque[tuple[str, bytes]] = deque()

    def take(self) -> list[tuple[str, bytes]]:
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
                if key.count("/") == pattern.count("/") and fnmatchcase(key, pattern):
                    inbox.waiting.append((key, payload))

        return put

    def listen(self, pattern: str) -> MemoryInbox:
        """Hear every key that the pattern matches, from now on."""
        inbox = MemoryInbox()
        self._listeners.append((pattern, inbox))
        return inbox

    def close(self) -> None:
        """Forget all listeners."""
        self._listeners.clear()
