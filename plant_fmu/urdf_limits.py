"""What a URDF says in each joint's <limit>: of its effort, N m or N, and of its position."""

from collections.abc import Container, Sequence
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
from numpy.typing import NDArray

_ENDING = frozenset({"revolute", "prismatic"})
_MOVING = _ENDING | {"continuous"}
"""Types of joints with limits of position, and of effort."""


def effort_limits(urdf: str, joints: Sequence[str]) -> NDArray[np.float64]:
    """Return the limits (m,) of joints by name; `ValueError` says which joint has none."""
    limits = np.array([_number(limit, "effort") for limit in _limits(urdf, joints, _MOVING)])
    for name, limit in zip(joints, limits, strict=True):
        if not 0 < limit < np.inf:
            raise ValueError(f"its URDF has no effort above 0 in <limit> of joint {name}")
    return limits


def position_limits(urdf: str, joints: Sequence[str]) -> NDArray[np.float64]:
    """Return the least and the most (m, 2) of joints by name; `ValueError` where there is no URDF.

    They are infinite of one that turns without end, is not there, or whose limits leave nothing.
    """
    found = []
    for limit in _limits(urdf, joints, _ENDING):
        least, most = (_number(limit, end) for end in ("lower", "upper"))
        found.append((least, most) if least < most else (-np.inf, np.inf))
    return np.array(found).reshape(-1, 2)


def _limits(urdf: str, joints: Sequence[str], kinds: Container[str | None]) -> list[Element | None]:
    try:
        every = fromstring(urdf).iter("joint")
    except ParseError as error:
        raise ValueError(f"there is no URDF in it: {error}") from None
    found = {
        joint.get("name"): joint.find("limit") for joint in every if joint.get("type") in kinds
    }
    return [found.get(name) for name in joints]


def _number(limit: Element | None, name: str) -> float:
    """Return an attribute, NaN where it is none."""
    try:
        return float("nan" if limit is None else limit.get(name, "nan"))
    except ValueError:
        return float("nan")
