"""FMUs by content: whoever has only a scenario's text and a digest finds the FMU of that digest.

What is under a digest has it, at every reading and writing; what has another is as if not there.
"""

import hashlib
import re
from pathlib import Path

from nrs_cosim.plant_fmu import cache
from nrs_cosim.plant_fmu.errors import FmuError

_DIGEST = re.compile("[0-9a-f]{64}")


def stored_fmu(sha256: str) -> Path | None:
    """Return where the FMU of a digest is kept, if it is; `FmuError` as in `cache.stored`."""
    return cache.stored(_name(sha256), sha256) if _DIGEST.fullmatch(sha256) else None


def keep_fmu(data: bytes, sha256: str) -> Path:
    """Keep an FMU's bytes; `FmuError` where they have another digest, or cannot be kept."""
    if (got := hashlib.sha256(data).hexdigest()) != sha256:
        raise FmuError(f"an FMU was to have sha256 {sha256}, but its bytes have {got}")
    return stored_fmu(sha256) or cache.keep(_name(sha256), data, sha256)


def _name(sha256: str) -> str:
    return f"by-sha256/{sha256}.fmu"
