"""What can be wrong with a recording; the whole tree is drawn in `bus.errors`.

Each message names the file, what was found, and what to do.
"""

from nrs_cosim.bus.errors import CosimError, InputError, RunError


class RecordingError(CosimError):
    """Something is wrong with a recording."""


class UnreadableError(RecordingError, InputError):
    """The file is no recording, or too damaged to be trusted."""


class UncreatableError(RecordingError, InputError):
    """No file can be made where the recording was to go."""


class UnwritableError(RecordingError, RunError):
    """The disk refused the recording, or it was closed already."""

    kind = "disk"
