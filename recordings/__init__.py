"""What was said: writing and reading it, and what follows from it.

`Recording` is the way in for users of Python; its `chunks` wants some of these tables.
"""

from nrs_cosim.recordings.export.tables import (
    AGENT_STATES,
    LINK_EVENTS,
    MEASUREMENTS,
    SAMPLES,
    STATES,
)
from nrs_cosim.recordings.recording import Recording

__all__ = ["AGENT_STATES", "LINK_EVENTS", "MEASUREMENTS", "SAMPLES", "STATES", "Recording"]
