"""What a URDF says of joints: their <limit> of position, effort and velocity, and <mimic>; SI."""

from collections.abc import Container, Sequence
from math import isfinite, nan
from typing import Any
from xml.etree.ElementTree import Element, ParseError, fromstring

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.plurals import plural

_ENDING = frozenset({"revolute", "prismatic"})
_MOVING = _ENDING | {"continuous"}
"""Types of joints with limits of position, and of effort."""
LIMITS, FRICTION = "joint limits", "dry friction"
"""What an FMU that is made of a URDF may leave out."""


def left_out(missing: Sequence[str]) -> str:
    """Return what ends the description of an FMU that is made of a URDF: what is not in it."""
    return f"; {' and '.join(missing)} left out" if missing else f"; with soft stops and {FRICTION}"


def has_stops(description: str | None) -> bool:
    """Return whether an FMU is one of a URDF's with stops, as its description says at its end."""
    return (description or "").endswith((left_out([FRICTION]), left_out([])))


def effort_limits(urdf: str, joints: Sequence[str]) -> NDArray[np.float64]:
    """Return the limits (m,) of joints by name; `ValueError` says which have none."""
    limits = np.array([_number(limit, "effort") for limit in _limits(urdf, joints, _MOVING)])
    without = [name for name, limit in zip(joints, limits, strict=True) if not 0 < limit < np.inf]
    if without:
        names = f"{plural('joint', len(without))} {', '.join(without)}"
        raise ValueError(f"its URDF has no effort above 0 in <limit> of {names}")
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


def joint_rows(urdf: str, joints: Sequence[str]) -> list[dict[str, Any]]:
    """Return what a URDF has of each joint that moves, for JSON; nothing of what is no URDF.

    `number` is a joint's among those that are given, which move by themselves; None is what is not
    there.
    """
    try:
        every = fromstring(urdf).iter("joint")
    except ParseError:
        return []
    return [_row(joint, joints) for joint in every if joint.get("type") in _MOVING]


def _row(joint: Element, joints: Sequence[str]) -> dict[str, Any]:
    name, kind, mimic = joint.get("name", ""), joint.get("type"), joint.find("mimic")
    of = ("lower", "upper") * (kind in _ENDING) + ("effort", "velocity")
    limits = {key: _number(joint.find("limit"), key) for key in of}
    return {
        "number": joints.index(name) + 1 if name in joints else None,
        "name": name,
        "type": kind,
        "unit": "m" if kind == "prismatic" else "rad",
        **dict.fromkeys(("lower", "upper", "effort", "velocity")),
        **{key: number for key, number in limits.items() if isfinite(number)},
        "mimics": None
        if mimic is None
        else {
            "joint": mimic.get("joint", ""),
            "multiplier": _number(mimic, "multiplier", 1.0),
            "offset": _number(mimic, "offset", 0.0),
        },
    }


def _limits(urdf: str, joints: Sequence[str], kinds: Container[str | None]) -> list[Element | None]:
    try:
        every = fromstring(urdf).iter("joint")
    except ParseError:
        raise ValueError("there is no URDF in it") from None
    found = {
        joint.get("name"): joint.find("limit") for joint in every if joint.get("type") in kinds
    }
    return [found.get(name) for name in joints]


def _number(element: Element | None, name: str, default: float = nan) -> float:
    """Return an attribute, NaN where it is none."""
    try:
        return float(default if element is None else element.get(name, default))
    except ValueError:
        return float("nan")
