"""What a robot's joints are called, and whether each turns or slides.

An FMU that was built from a URDF says it in `extra/nrs_cosim/joints.json` (FMI keeps `extra/` for
such data): a list with the `name` and `unit`, rad or m, of each joint.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated
from zipfile import ZipFile

from pydantic import Field, TypeAdapter, ValidationError

from nrs_cosim.plant_fmu.errors import FmuError

JOINTS = "extra/nrs_cosim/joints.json"
MOST_BYTES = 1 << 20


@dataclass(frozen=True, slots=True)
class Joint:
    """A joint's name, and the unit of its coordinate; the unit is empty where none is known."""

    name: str
    unit: Annotated[str, Field(pattern="^(rad|m|)$")]


_LIST = TypeAdapter(tuple[Joint, ...])


def read_joints(archive: ZipFile, label: str) -> tuple[Joint, ...]:
    """Return the joints that an archive names, none where it does not; `FmuError` names the file.

    It has been looked at as a whole, see `archives.entries`.
    """
    if JOINTS not in archive.namelist():
        return ()
    if archive.getinfo(JOINTS).file_size > MOST_BYTES:
        raise FmuError(f"{label}: its {JOINTS} is larger than {MOST_BYTES >> 20} MiB")
    try:
        return _LIST.validate_json(archive.read(JOINTS))
    except ValidationError as error:
        wrong = error.errors(include_url=False)[0]
        where = ".".join(map(str, wrong["loc"])) or "all of it"
        raise FmuError(f"{label}: its {JOINTS} cannot be used: {where}: {wrong['msg']}") from None


def write_joints(joints: Sequence[Joint]) -> bytes:
    """Return the file's content."""
    return _LIST.dump_json(tuple(joints), indent=1)
