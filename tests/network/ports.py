"""A port that nobody listens on, from the operating system."""

import socket


def free_port() -> int:
    """Return a port of loopback's that was free a moment ago."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])
