"""Runs `nrs`, and presses Ctrl-C at a place of it: how often, at which call of what, and then its
arguments. The journal becomes a part at its second row.
"""

import os
import signal
import sys
from importlib import import_module

from nrs_cosim.orchestrator.__main__ import main
from nrs_cosim.orchestrator.study.store import StudyStore

PLACES = {
    "read": ("nrs_cosim.orchestrator.study.points:PointReader", "at"),
    "rolled": ("nrs_cosim.recordings.export.row_parts:parquet", "write_table"),
    "cut": ("nrs_cosim.orchestrator.study.store:os", "ftruncate"),
}


def press(place, call, times):
    """Let one call of a place begin with so many signals."""
    (module, _, name), attribute = PLACES[place][0].partition(":"), PLACES[place][1]
    owner = getattr(import_module(module), name)
    whole, calls = getattr(owner, attribute), [0]

    def pressed(*arguments, **keywords):
        calls[0] += 1
        for _ in range(times if calls[0] == call else 0):
            os.kill(os.getpid(), signal.SIGINT)
        return whole(*arguments, **keywords)

    setattr(owner, attribute, pressed)


StudyStore.roll.__defaults__ = (2,)
press(sys.argv[1], *map(int, sys.argv[2:4]))
sys.argv[1:] = sys.argv[4:]
main()
