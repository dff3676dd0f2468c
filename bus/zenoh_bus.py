"""The bus over one Eclipse Zenoh session that opens no socket: nobody listens, nobody scouts.

A put reaches the session's own subscribers before it returns (session-local delivery), so what
was put before `take` is in what `take` returns. The run's id is the session's namespace: it stands
before every key on the wire, and keys in the code do not show it.
"""

from collections import deque

import zenoh
from zenoh.handlers import Callback

from bus.endpoints import Endpoints
from bus.sessions import open_session
from bus.transport import Put


class ZenohInbox:
    """A subscription of a `ZenohBus`; a C callable appends, and no Python runs in its threads."""

    def __init__(self, session: zenoh.Session, pattern: str) -> None:
        self._waiting: deque[zenoh.Sample] = deque()
        self._subscriber = session.declare_subscriber(
            pattern, Callback(self._waiting.append, indirect=False)
        )

    def take(self) -> list[tuple[str, bytes]]:
        """Return all that arrived, in order."""
        pop = self._waiting.popleft
        taken = [pop() for _ in range(len(self._waiting))]
        return [(str(sample.key_expr), sample.payload.to_bytes()) for sample in taken]


class ZenohBus:
    """One Zenoh session of a run."""

    def __init__(self, run_id: str) -> None:
        self.session = open_session(Endpoints(), namespace=f"nrs/{run_id}")

    def publisher(self, key: str) -> Put:
        """Declare the right to put on a key; reliable, and blocking rather than dropping."""
        publisher = self.session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.BLOCK,
            reliability=zenoh.Reliability.RELIABLE,
        )
        return publisher.put

    def listen(self, pattern: str) -> ZenohInbox:
        """Hear every key that the pattern matches, from now on."""
        return ZenohInbox(self.session, pattern)

    def close(self) -> None:
        """Close the session and all that was declared on it."""
        self.session.close()  # type: ignore[no-untyped-call]
