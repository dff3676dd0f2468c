"""Processes that run points end with whoever started them, and leave Ctrl-C to it.

They are forked from a server that has loaded what a run needs, and holds no session and no thread;
where there is none such, as on macOS, each is started anew. None runs the caller's script again, of
which it needs nothing. A process that was killed breaks its pool for all, so a pool is made again,
by the loop of `dispatch`.
"""

import multiprocessing
import os
import signal
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import connection, parent_process, spawn
from threading import Thread
from typing import Any

LOADED = ["nrs_cosim.orchestrator.study.point_run"]


class SerialExecutor(Executor):
    """Runs what is submitted at once, in this thread."""

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Run it, and return what is done already."""
        future: Future[Any] = Future()
        future.set_running_or_notify_cancel()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # the future's
            future.set_exception(error)
        return future


class PoolExecutor(ProcessPoolExecutor):
    """Processes of this machine; whoever calls may be killed, and they end."""

    def __init__(self, jobs: int) -> None:
        linux = sys.platform.startswith("linux")
        context = multiprocessing.get_context("forkserver" if linux else "spawn")
        if linux:
            context.set_forkserver_preload(LOADED)
        super().__init__(jobs, mp_context=context, initializer=begin)

    def submit(self, fn: Callable[..., Any], /, *args: Any, **kwargs: Any) -> Future[Any]:
        """Submit; a process that is started for it never sees Ctrl-C, from its beginning on."""
        with _no_interrupt(), _no_script():
            return super().submit(fn, *args, **kwargs)

    def kill_workers(self) -> None:
        """End all processes at once."""
        for process in [*(self._processes or {}).values()]:
            process.kill()


def begin() -> None:
    """Begin as a process of a pool."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    parent = parent_process()
    if parent is not None:
        Thread(target=_end_with, args=(parent.sentinel,), daemon=True).start()


def _end_with(sentinel: int) -> None:
    connection.wait([sentinel])
    os._exit(1)


@contextmanager
def _no_interrupt() -> Iterator[None]:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextmanager
def _no_script() -> Iterator[None]:
    """Let processes that are started know all but the caller's script, which they would import."""
    whole = spawn.get_preparation_data

    def without(name: str) -> dict[str, Any]:
        known = whole(name).items()
        return {key: value for key, value in known if not key.startswith("init_main_from")}

    spawn.get_preparation_data = without
    try:
        yield
    finally:
        spawn.get_preparation_data = whole
