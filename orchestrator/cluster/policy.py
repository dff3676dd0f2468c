"""What is done about workers that come and go."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class WorkerPolicy:
    """What is done about workers that come and go."""

    restart: bool
    """Whether the run goes on without one that is gone."""
    wait: float
    """s: how long a robot may be without a worker."""
    show: Callable[[str], None]
    """Is told in words who comes and goes."""
    expected: int = 1
    """How many workers share the robots, where they do not name their robots."""
