"""An asset is what a scenario names and a run needs beside its text, known by its content.

Edges and samples in files of others become tables (CSV) when a scenario is resolved, each kind of
one form. A recording and the workers of a run have these beside the text, which stays as it was
written: nobody reads the file again, or needs what its format needs. A user may add the FMUs.
"""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

TABLE, FMU = "text/csv", "application/zip"
"""Media types."""


@dataclass(frozen=True, slots=True)
class Asset:
    """A value by its content."""

    name: str
    """What the scenario calls it: the path of a file, or a bundled model."""
    source_sha256: str
    """Of the file that it was made from."""
    media_type: str
    content: bytes = field(repr=False)
    sha256: str
    """Of the content."""

    @classmethod
    def of(cls, name: str, source_sha256: str, media_type: str, content: bytes) -> "Asset":
        """Return content as an asset."""
        return cls(name, source_sha256, media_type, content, sha256_of(content))

    @property
    def attachment(self) -> str:
        """What it is called in a recording."""
        return f"{self.sha256}{'.fmu' if self.media_type == FMU else '.csv'}"


Assets = Mapping[str, Asset]
"""By the field that names each: `network.edges`, `target.file`, …"""
NO_ASSETS: Assets = MappingProxyType({})


def sha256_of(content: bytes) -> str:
    """Return the digest of bytes."""
    return hashlib.sha256(content).hexdigest()
