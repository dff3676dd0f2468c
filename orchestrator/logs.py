"""What long-lived processes log: workers, their coordinator, the live page; with level and time.

Each module has a logger of its own below `nrs_cosim`. A program of a user's own sets them up as any
other; the command does it by `--log-level`, on standard error, also for the processes that it
starts. What a user must know is told without it.
"""

import logging
import os
import sys
from typing import Literal

Level = Literal["debug", "info", "warning", "error"]
_LEVEL = "NRS_LOG_LEVEL"
"""By which a process that is started here knows the level."""


def log_to_standard_error(level: Level) -> None:
    """Write what is logged from a level on, here and in processes that are started from now on."""
    os.environ[_LEVEL] = level
    log_as_asked()


def are_logs_asked() -> bool:
    """Return whether processes that are started from now on write what is logged."""
    return _LEVEL in os.environ


def log_as_asked(descriptor: int | None = None, who: str = "") -> None:
    """Write what is logged as the process that started this one does: who says it, then the words.

    It goes to this one's standard error, or to another open file by its descriptor.
    """
    if level := os.environ.get(_LEVEL):
        stream = sys.stderr if descriptor is None else os.fdopen(descriptor, "w", encoding="utf-8")
        handler = logging.StreamHandler(stream)
        form = "%(asctime)s.%(msecs)03d %(levelname)s %(name)s[%(process)d]: "
        form += f"{who}: %(message)s" if who else "%(message)s"
        handler.setFormatter(logging.Formatter(form, "%Y-%m-%dT%H:%M:%S"))
        logger = logging.getLogger("nrs_cosim")
        logger.handlers[:] = [handler]
        logger.setLevel(level.upper())
