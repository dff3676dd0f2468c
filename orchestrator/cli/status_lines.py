"""Where there is no terminal, long work says in lines what it is at: never silent, never chatty.

The first line comes after two seconds, the next when something else begins, and every ten seconds.
Where NRS_PROGRESS is `off` there is none, as for logs that two runs are compared by.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread

from rich.console import Console

PATIENCE, EVERY = 2.0, 10.0
"""s, of wall time"""


@contextmanager
def status_lines(
    console: Console, status: Callable[[], str], over: Event | None = None
) -> Iterator[Callable[[], None]]:
    """Print what `status` returns, if anything; yield what is called when it becomes another.

    `over` is what ends it, and whose waiting is its clock.
    """
    if os.environ.get("NRS_PROGRESS") == "off":
        yield lambda: None
        return
    ended, speaking = over or Event(), False

    def speak() -> None:
        if text := status():
            console.print(f"progress: {text}", markup=False)

    def watch() -> None:
        nonlocal speaking
        delay = PATIENCE
        while not ended.wait(delay):
            speaking, delay = True, EVERY
            speak()

    def changed() -> None:
        if speaking:
            speak()

    thread = Thread(target=watch, name="status lines", daemon=True)
    thread.start()
    try:
        yield changed
    finally:
        ended.set()
        thread.join()
