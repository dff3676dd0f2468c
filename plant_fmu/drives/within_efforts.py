"""Torque limits that a scenario leaves to the URDF of the FMU become numbers."""

from collections.abc import Sequence
from dataclasses import replace

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.plants import Body
from nrs_cosim.plant_fmu.urdf_limits import effort_limits


def within_efforts(archive: Archive, bodies: Sequence[Body]) -> Sequence[Body]:
    """Return bodies whose torque limits are known, where they are those of the FMU's URDF."""
    limited = []
    for body in bodies:
        own = body
        if body.control.limited_by_effort:
            names = [joint.name for joint in archive.joints]
            try:
                limits = effort_limits(archive.urdf, names)
            except ValueError as error:
                raise FmuError(
                    f"{archive.label}: controller.torque_limit of robot {body.robot}: {error}; "
                    "give numbers, one for each joint"
                ) from None
            control = replace(body.control, torque_limit=limits, limited_by_effort=False)
            own = replace(body, control=control)
        limited.append(own)
    return limited
