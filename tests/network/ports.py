"""Ports of loopback that nobody listens on, and that the system gives to no one else.

Those that it gives away by itself begin above: a port of its own choice, let go again, may be
another process's by the time that it is used. Each process of the tests begins elsewhere.
"""

import os
import socket
from itertools import count

FIRST, LAST = 12_000, 32_000
_next = count(os.getpid() * 131)


def free_port() -> int:
    """Return a port that is free, and that this process does not return again soon."""
    for turn in _next:
        port = FIRST + turn % (LAST - FIRST)
        with socket.socket() as taken:
            try:
                taken.bind(("127.0.0.1", port))
            except OSError:
                continue
        return port
    raise AssertionError
