"""A signal that asks a run to end: the run closes its recording first.

The first signal is kept until the run asks for it, as it does at each output time. The second ends
everything at once. While nobody has asked, a run is still being set up, and the first does so too.

Python delivers signals to the main thread alone. A run in another thread is ended by what watches
it. The interpreter does not exit before its recording is closed: it waits for the run's end, which
it asks for where Ctrl-C has ended the main thread, or the thread is a daemon.
"""

import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from types import FrameType


@contextmanager
def interrupts(numbers: Sequence[signal.Signals]) -> Iterator[Callable[[], bool]]:
    """Yield a call that returns whether one of some signals has asked the run to end."""
    if threading.current_thread() is not threading.main_thread():
        run = _ThreadRun()
        _thread_runs().add(run)
        try:
            yield run.exiting.is_set
        finally:
            _thread_runs().discard(run)
            run.done.set()
        return
    began = asked_to_end = False

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal asked_to_end
        if not began:
            raise KeyboardInterrupt("before the run began; nothing is recorded")
        if asked_to_end:
            raise KeyboardInterrupt("twice, so at once")
        asked_to_end = True

    def ask() -> bool:
        nonlocal began
        began = True
        return asked_to_end

    before = {number: signal.signal(number, stop) for number in numbers}
    try:
        yield ask
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


class _ThreadRun:
    """A run in a thread that is not the main one."""

    def __init__(self) -> None:
        self.exiting, self.done = threading.Event(), threading.Event()
        self.is_daemon = threading.current_thread().daemon


@cache
def _thread_runs() -> set[_ThreadRun]:
    """Return all such runs that are under way, for which the interpreter's exit is to wait.

    `atexit` would be too late: by then no executor takes work, and a recording is written by one.
    What is registered here is called before, the last one first.
    """
    runs: set[_ThreadRun] = set()

    def end() -> None:
        interrupted = issubclass(getattr(sys, "last_type", None) or Exception, KeyboardInterrupt)
        for run in [*runs]:
            if interrupted or run.is_daemon:
                run.exiting.set()
            run.done.wait()

    threading._register_atexit(end)  # type: ignore[attr-defined]
    return runs
