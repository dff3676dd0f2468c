"""Points are given to an executor, a few at a time, and each row is kept before more are given.

`concurrent.futures.Executor` is all that is asked of an engine. When one breaks, because a process
of it was killed, the points under way are suspects: they are run again one by one, each alone. One
that breaks the engine alone too has the row `crashed`, or `timeout` where its time was over. That
an engine is gone altogether, or was cancelled, is no point's fault: no row is written of it, and
the study can be resumed.
"""

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass, replace
from pathlib import Path
from time import monotonic
from typing import Any

from nrs_cosim.orchestrator.errors import EngineGoneError
from nrs_cosim.orchestrator.study.point_run import NeedsFmus, PointTask, last_moment, run_point
from nrs_cosim.orchestrator.study.rows import StudyRow

AHEAD = 2
"""Points given for each that can run at once, so that nobody waits for the next."""
KILLED = ("KilledWorker",)
"""What executors of others raise of a task that killed its process."""


@dataclass(frozen=True, slots=True)
class StudyEngine:
    """Who runs points, and how many at once."""

    open: Callable[[], Executor]
    """Returns an executor, another one when one has broken."""
    window: int
    """Points given at most."""
    close: Callable[[Executor], None] = lambda executor: executor.shutdown(cancel_futures=True)


@dataclass(frozen=True, slots=True)
class _Attempt:
    task: PointTask
    alone: bool
    since: float


def dispatch(
    tasks: Iterable[PointTask],
    engine: StudyEngine,
    put: Callable[[StudyRow], None],
    stopped: Callable[[], bool] = lambda: False,
) -> None:
    """Run all tasks, until `stopped` says so; then those that run come to their end.

    Raises `EngineGoneError` when nobody runs points any more.
    """
    _Dispatch(iter(tasks), engine, put, stopped).run()


class _Dispatch:
    """Points on their way through an executor, which is replaced when it breaks."""

    def __init__(
        self,
        waiting: Iterator[PointTask],
        engine: StudyEngine,
        put: Callable[[StudyRow], None],
        stopped: Callable[[], bool],
    ) -> None:
        self._waiting, self._engine, self._put, self._stopped = waiting, engine, put, stopped
        self._suspects: deque[PointTask] = deque()
        self._under_way: dict[Future[Any], _Attempt] = {}
        self._executor = engine.open()
        self._is_broken = False

    def run(self) -> None:
        """Run all; a second interrupt ends what runs at once."""
        try:
            while True:
                self._fill()
                if self._stopped():
                    for future in [future for future in self._under_way if future.cancel()]:
                        del self._under_way[future]
                if not self._under_way and not self._is_broken:
                    return
                done, _ = wait(self._under_way, return_when=FIRST_COMPLETED)
                self._take(done)
                if self._is_broken:
                    self._begin_again()
        except KeyboardInterrupt:
            getattr(self._executor, "kill_workers", lambda: None)()
            raise
        finally:
            self._engine.close(self._executor)

    def _fill(self) -> None:
        """Give what there is room for; a suspect only when nothing else is under way."""
        while not self._stopped() and not self._is_broken:
            if self._suspects:
                if not self._under_way:  # in a process that nothing else has been in
                    self._open_again()
                    self._submit(self._suspects.popleft(), alone=True)
                return
            if len(self._under_way) >= self._engine.window:
                return
            task = next(self._waiting, None)
            if task is None:
                return
            self._submit(task, alone=False)

    def _submit(self, task: PointTask, *, alone: bool) -> None:
        try:
            future = self._executor.submit(run_point, task)
        except BrokenExecutor:  # by something that is under way, or that nobody runs
            self._is_broken = True
            self._suspects.append(task)
            return
        self._under_way[future] = _Attempt(task, alone, monotonic())

    def _take(self, done: Iterable[Future[Any]]) -> None:
        """Keep the rows of points that are done, and raise what is no point's fault after it."""
        gone: EngineGoneError | None = None
        for future in done:
            attempt = self._under_way.pop(future)
            try:
                found = _found(future)
            except EngineGoneError as error:
                gone = error
                continue
            if isinstance(found, NeedsFmus):
                self._submit(_with_fmus(attempt.task, found), alone=attempt.alone)
            elif isinstance(found, StudyRow):
                self._put(replace(found, tries=1 + attempt.alone))
            else:
                self._is_broken |= found is None
                if attempt.alone or found is not None:
                    self._put(_crashed(attempt))
                else:
                    self._suspects.append(attempt.task)
        if gone:
            raise gone

    def _begin_again(self) -> None:
        """Take what was done before all broke; the rest is run again, one by one."""
        self._open_again()
        self._take([*self._under_way])
        self._is_broken = False

    def _open_again(self) -> None:
        self._engine.close(self._executor)
        self._executor = self._engine.open()


class _Killed:
    """A task that killed several processes of an executor that goes on."""


def _found(future: Future[Any]) -> StudyRow | NeedsFmus | _Killed | None:
    """Return what came of a point; None where it, or another one, has broken the executor."""
    try:
        found = future.result()
    except BrokenExecutor:
        return None
    except CancelledError as error:
        raise EngineGoneError("who ran the points is gone; the same command resumes") from error
    except Exception as error:
        if type(error).__name__ in KILLED:
            return _Killed()
        why = f"{type(error).__name__}: {error}"
        raise EngineGoneError(
            f"who ran the points is gone: {why}; the same command resumes"
        ) from error
    return found if isinstance(found, NeedsFmus) else StudyRow.of(found)


def _crashed(attempt: _Attempt) -> StudyRow:
    task, took = attempt.task, monotonic() - attempt.since
    late = task.limit is not None and took >= last_moment(task.limit)
    return StudyRow(
        key=task.key,
        point=task.point,
        scenario=task.name,
        seed=task.seed,
        status="timeout" if late else "crashed",
        cause_kind="deadline" if late else "worker",
        reason="a call did not return in time, and its process was ended"
        if late
        else "it ended its process, also when it was alone",
        tries=2,
    )


def _with_fmus(task: PointTask, needed: NeedsFmus) -> PointTask:
    """Return a task with FMUs that a process asked for."""
    paths = {sha256: Path(task.folder) / name for name, sha256 in task.fmus.items()}
    return replace(task, content={sha256: paths[sha256].read_bytes() for sha256 in needed.sha256})
