"""A run to whoever listens, from its growing recording: the run itself knows nothing of it.

The recording is the queue between the two, so the run waits for nobody and nothing is lost on the
way. It is read as long as somebody listens, from its beginning: who comes first, or late, gets what
was before too.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from threading import Event
from time import monotonic

from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.foxglove.server import Server
from nrs_cosim.recordings.mcap.growing import GrowingReader

LOOKED_AT = 0.05
"""s: how often, for more of a run."""
LINGER = 3.0
"""s: how long clients may take what is sent last."""


def head_of(path: Path, is_new: Callable[[], bool], over: Event) -> GrowingReader | None:
    """Wait for the head of a recording that is new; None when the run is over before."""
    while not over.wait(LOOKED_AT):
        if is_new():
            with suppress(UnreadableError):
                return GrowingReader(path)
    return None


def follow(
    reader: GrowingReader, server: Server, over: Event, has_listeners: Callable[[], bool]
) -> None:
    """Send what comes into a recording, until the run is over and all that is there was sent.

    It is sent while `has_listeners`, and at the end to whoever listens; then clients have a while
    to take it, or leave.
    """
    was_over, sent = False, monotonic()
    while not was_over:
        was_over = over.wait(LOOKED_AT)
        if has_listeners() or (was_over and server.subscriptions):
            for columns in reader.grown():
                server.send(columns)
                sent = monotonic()
    with server.changed:
        left = sent + LINGER - monotonic()
        server.changed.wait_for(lambda: not server.subscriptions, max(0.0, left))
