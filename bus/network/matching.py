"""Whether somebody listens: Zenoh tells a publisher of it, also one of a pattern of keys."""

from queue import Empty, SimpleQueue
from typing import Any

import zenoh
from zenoh.handlers import Callback


def wait_for_match(session: zenoh.Session, key: str, seconds: float) -> bool:
    """Wait until somebody listens on a key, or on one that a pattern matches.

    Return whether that was in time.
    """
    received: SimpleQueue[zenoh.MatchingStatus] = SimpleQueue()
    publisher: Any = session.declare_publisher(key)
    listener: Any = publisher.declare_matching_listener(Callback(received.put, indirect=False))
    try:
        status: Any = publisher.matching_status  # typed as a truth, which it is not
        return bool(status.matching or received.get(timeout=seconds).matching)
    except Empty:
        return False
    finally:
        listener.undeclare()
        publisher.undeclare()
