"""Each joint's limit of effort in a URDF: the most of its torque, N m, or force, N."""

from collections.abc import Sequence
from xml.etree.ElementTree import ParseError, fromstring

import numpy as np
from numpy.typing import NDArray


def effort_limits(urdf: str, joints: Sequence[str]) -> NDArray[np.float64]:
    """Return the limits (m,) of joints by name; `ValueError` says which joint has none."""
    try:
        found = {joint.get("name"): joint.find("limit") for joint in fromstring(urdf).iter("joint")}
    except ParseError as error:
        raise ValueError(f"there is no URDF in it: {error}") from None
    limits = []
    for name in joints:
        limit = found.get(name)
        effort = "" if limit is None else limit.get("effort", "")
        try:
            limits.append(float(effort))
        except ValueError:
            limits.append(0.0)
        if not 0 < limits[-1] < np.inf:
            raise ValueError(f"its URDF has no effort above 0 in <limit> of joint {name}")
    return np.array(limits)
