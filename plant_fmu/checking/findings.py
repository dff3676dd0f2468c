"""What is found of an FMU that may be a robot.

Each finding holds, fails, is unknown for a reason, or is a note; they come one after another, so
that those before a crash are known.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.plants import Body

FindingStatus = Literal["holds", "fails", "unknown", "note"]


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at."""

    topic: str
    """valid, loads, variables, drives, physics or runs"""
    name: str
    status: FindingStatus
    text: str
    value: float | None = None
    """The number that decided, where there is one and it is finite."""


@dataclass(frozen=True, slots=True)
class CheckTask:
    """What is to be checked, as a scenario tells it where there is one."""

    archive: Archive
    body: Body | None = None
    """The robot; without one, it is at the FMU's start values, with gains fitted to its inertia."""
    names: Mapping[str, Spec] = field(default_factory=dict)
    driving: Driving = field(default_factory=Driving)


@dataclass(frozen=True, slots=True)
class FmuCheck:
    """All findings of an FMU."""

    fmu: str
    sha256: str
    findings: tuple[Finding, ...]

    @property
    def passes(self) -> bool:
        """Whether nothing fails."""
        return all(finding.status != "fails" for finding in self.findings)

    def as_json(self) -> dict[str, Any]:
        """Return the findings for JSON."""
        return {
            "fmu": self.fmu,
            "sha256": self.sha256,
            "passes": self.passes,
            "findings": [asdict(finding) for finding in self.findings],
        }
