"""Long work is seen to go on, on the error output: a terminal's is gone when it is done.

A run goes by simulated time. What reads recordings goes by the part of the file that was read, pass
by pass, and what builds an FMU by stages; neither shows anything unless it takes longer than two
seconds. In a pipe all of them are lines: the first comes after two seconds, the next when something
else begins, and every ten seconds. Where NRS_PROGRESS is `off` there is none, as for logs that two
runs are compared by.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from os import PathLike
from pathlib import Path
from threading import Event, Thread
from time import monotonic
from typing import TYPE_CHECKING

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from nrs_cosim.bus.clock import Clock, seconds

if TYPE_CHECKING:
    from nrs_cosim.recordings.mcap.reader import Reader


PATIENCE, EVERY = 2.0, 10.0
"""s, of wall time"""


@contextmanager
def status_lines(
    console: Console,
    status: Callable[[], str],
    over: Event | None = None,
    now: Callable[[], float] = monotonic,
) -> Iterator[Callable[[], None]]:
    """Print what `status` returns, if anything; yield what is called when it becomes another.

    What is still as it was is printed with for how long it is. `over` is what ends it, and whose
    waiting is its clock.
    """
    if os.environ.get("NRS_PROGRESS") == "off":
        yield lambda: None
        return
    ended, speaking = over or Event(), False
    said, since = "", 0.0

    def speak() -> None:
        nonlocal said, since
        text, more = status(), ""
        if text == said:
            more = f" … {now() - since:.0f} s"
        else:
            said, since = text, now()
        if text:
            console.print(f"progress: {text}{more}", markup=False)

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


Watch = Callable[[float], None]
"""Is told how far the work is."""


class _SimulatedTime(ProgressColumn):
    def render(self, task: Task) -> Text:
        speed = f"{task.speed:.3g} x real time" if task.speed else ""
        return Text(f"t = {task.completed:g} of {task.total:g} s  {speed}")


def _left() -> tuple[ProgressColumn, ...]:
    return TimeRemainingColumn(compact=True), TextColumn("left")


@contextmanager
def running(console: Console, clock: Clock) -> Iterator[Watch]:
    """Show simulated time, speed and time left while a run goes on."""
    total = seconds(clock.t(clock.ticks))
    if not console.is_terminal:
        reached: float | None = None

        def reach(t: float) -> None:
            nonlocal reached
            reached = t

        def status() -> str:
            return "starting" if reached is None else f"t = {reached:g} of {total:g} s"

        with status_lines(console, status):
            yield reach
        return
    columns = (BarColumn(), _SimulatedTime(), *_left())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("run", total=total)
        yield lambda t: bar.update(task, completed=t)


@contextmanager
def reading(
    console: Console, now: Callable[[], float] = monotonic
) -> Iterator[Callable[[str | PathLike[str]], Watch]]:
    """Yield what begins a bar for a recording, and returns who is told what part of it was read."""
    if not console.is_terminal:
        with _reading_lines(console) as follow_in_lines:
            yield follow_in_lines
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), *_left())
    bar = Progress(*columns, console=console, transient=True, redirect_stdout=False)
    begun, over = now(), False

    def follow(path: str | PathLike[str]) -> Watch:
        task = bar.add_task(f"reading {escape(Path(path).name)}", total=1.0)
        before = 0.0

        def watch(part: float) -> None:
            nonlocal before
            if part < before:
                bar.reset(task)
            before = part
            bar.update(task, completed=part)
            if not over and now() - begun > PATIENCE:
                bar.start()

        return watch

    try:
        yield follow
    finally:
        over = True
        bar.stop()


@contextmanager
def _reading_lines(console: Console) -> Iterator[Callable[[str | PathLike[str]], Watch]]:
    at = ""

    def follow(path: str | PathLike[str]) -> Watch:
        def watch(part: float) -> None:
            nonlocal at
            at = f"reading {Path(path).name}, {part:.0%}"

        watch(0.0)
        return watch

    with status_lines(console, lambda: at):
        yield follow


@contextmanager
def opened(console: Console, path: Path) -> Iterator["Reader"]:
    """Open a recording, which takes long where its chunks have to be judged one by one."""
    from nrs_cosim.recordings.mcap.reader import Reader  # noqa: PLC0415, for these alone

    with ExitStack() as stack:
        with reading(console) as follow:
            reader = stack.enter_context(Reader(path, watch=follow(path)))
        yield reader


class _Stage:
    """What is being done, and for how long."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now, self._name = now, ""
        self._start = self._begun = now()

    def begin(self, name: str) -> None:
        self._name, self._begun = name, self._now()

    def __rich__(self) -> RenderableType:
        now = self._now()
        if now - self._start <= PATIENCE:
            return Group()
        return f"{escape(self._name)} … {now - self._begun:.0f} s"


@contextmanager
def stages(
    console: Console, now: Callable[[], float] = monotonic
) -> Iterator[Callable[[str], None]]:
    """Yield what is told of each stage as it begins."""
    if not console.is_terminal:
        current = ""
        with status_lines(console, lambda: current) as changed:

            def begin_line(name: str) -> None:
                nonlocal current
                current = name
                changed()

            yield begin_line
        return
    stage = _Stage(now)
    with Live(stage, console=console, transient=True, redirect_stdout=False) as live:

        def begin(name: str) -> None:
            stage.begin(name)
            live.refresh()

        yield begin
