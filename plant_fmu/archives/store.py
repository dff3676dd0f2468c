"""FMUs by content: whoever has only a scenario's text and a digest finds the FMU of that digest.

What is under a digest has it, at every reading and writing; what has another is as if not there.
"""

import hashlib
import re
from pathlib import Path

from plant_fmu.bundled.building import cache_folder, replacing
from plant_fmu.errors import FmuError

_DIGEST = re.compile("[0-9a-f]{64}")


def stored(sha256: str) -> Path | None:
    """Return where the FMU of a digest is kept, if it is."""
    if not _DIGEST.fullmatch(sha256):
        return None
    path = _path(sha256)
    try:
        return path if _digest(path.read_bytes()) == sha256 else None
    except OSError:
        return None


def keep(data: bytes, sha256: str) -> Path:
    """Keep an FMU's bytes; `FmuError` where they have another digest, or cannot be kept."""
    if (got := _digest(data)) != sha256:
        raise FmuError(f"an FMU was to have sha256 {sha256}, but its bytes have {got}")
    if kept := stored(sha256):
        return kept
    path = _path(sha256)
    with replacing(path) as part:
        part.write_bytes(data)
    return path


def _path(sha256: str) -> Path:
    return cache_folder() / "by-sha256" / f"{sha256}.fmu"


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
