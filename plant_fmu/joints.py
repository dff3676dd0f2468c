"""What a robot's joints are called, and whether each turns or slides.

An FMU that was built from a URDF says it in `extra/nrs_cosim/joints.json` (FMI keeps `extra/` for
such data): a list with the `name` and `unit`, rad or m, of each joint. Beside it stands what was
kept of the URDF, `extra/nrs_cosim/robot.urdf`, which says how the robot is drawn.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated
from zipfile import ZipFile

from pydantic import ConfigDict, Field, TypeAdapter, ValidationError

from nrs_cosim.plant_fmu.errors import FmuError

JOINTS = "extra/nrs_cosim/joints.json"
URDF = "extra/nrs_cosim/robot.urdf"
MOST_BYTES = {JOINTS: 1 << 20, URDF: 64 << 20}


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint's name, and the unit of its coordinate; the unit is empty where none is known."""

    name: str
    unit: Annotated[str, Field(pattern="^(rad|m|)$")]


_LIST = TypeAdapter(tuple[Joint, ...], config=ConfigDict(defer_build=True))


def read_joints(archive: ZipFile, label: str) -> tuple[Joint, ...]:
    """Return the joints that an archive names, none where it does not; `FmuError` names the file.

    It has been looked at as a whole, see `archives.entries`.
    """
    content = _read(archive, label, JOINTS)
    if content is None:
        return ()
    try:
        return _LIST.validate_json(content)
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        where = ".".join(map(str, wrong["loc"])) or "all of it"
        raise FmuError(f"{label}: its {JOINTS} cannot be used: {where}: {wrong['msg']}") from None


def read_urdf_text(archive: ZipFile, label: str) -> str:
    """Return the URDF that an archive holds, nothing where there is none; raises likewise."""
    try:
        return (_read(archive, label, URDF) or b"").decode()
    except UnicodeDecodeError as error:
        raise FmuError(f"{label}: its {URDF} cannot be used: it is no text: {error}") from None


def _read(archive: ZipFile, label: str, name: str) -> bytes | None:
    if name not in archive.namelist():
        return None
    if archive.getinfo(name).file_size > MOST_BYTES[name]:
        raise FmuError(f"{label}: its {name} is larger than {MOST_BYTES[name] >> 20} MiB")
    return archive.read(name)


def write_joints(joints: Sequence[Joint]) -> bytes:
    """Return the file's content."""
    return _LIST.dump_json(tuple(joints), indent=1)
