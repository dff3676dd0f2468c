"""Which stage of long work is on: on a terminal only, once there is a wait to be explained."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import monotonic

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.markup import escape

AFTER = 2.0
"""s, from the beginning of the first stage."""


class _Stage:
    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock, self._name = clock, ""
        self._start = self._begun = clock()

    def begin(self, name: str) -> None:
        self._name, self._begun = name, self._clock()

    def __rich__(self) -> RenderableType:
        now = self._clock()
        if now - self._start < AFTER:
            return Group()
        return f"{escape(self._name)} … {now - self._begun:.0f} s"


@contextmanager
def stages(
    console: Console, clock: Callable[[], float] = monotonic
) -> Iterator[Callable[[str], None]]:
    """Yield what is to be told as each stage begins, by its name."""
    stage = _Stage(clock)
    if not console.is_terminal:
        yield stage.begin
        return
    with Live(stage, console=console, transient=True) as live:

        def begin(name: str) -> None:
            stage.begin(name)
            live.refresh()

        yield begin
