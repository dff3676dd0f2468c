"""What the recording's writer does by native code, which it gets from whoever can compile it."""

from functools import cache

from nrs_cosim.plant_fmu.bundled.builder import build_library
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.recordings.mcap.arrangement import Arranging, by_numpy
from nrs_cosim.recordings.mcap.native.arrangement import SOURCE, arranging_by


@cache
def load_arranging() -> Arranging:
    """Return how a chunk's messages are arranged best: by NumPy where nothing can be compiled."""
    try:
        return arranging_by(build_library("arrangement", {SOURCE.name: SOURCE.read_bytes()}))
    except (FmuError, OSError):
        return by_numpy
