"""The part of a URDF that is to move: joints are locked, or a chain is taken out of the whole.

A locked joint is a fixed one: what it carries stays, with its inertia. So does what hangs on a
chain, locked, while what is above its base is gone, for that base is fixed. A joint that mimics a
locked one is locked where that puts it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from nrs_cosim.bus.plurals import plural
from nrs_cosim.bus.text import nearest, quoted
from nrs_cosim.plant_fmu.bundled.rotations import multiplied
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import Link, UrdfJoint

FREE = {"floating", "planar"}


@dataclass(frozen=True, slots=True)
class Selection:
    """What a user wants of a URDF; by itself, all its links without friction and stops."""

    lock: Mapping[str, float | None] = field(default_factory=dict)
    """Joints and where they are locked, rad or m; None for what is nearest to 0 in their limits."""
    base: str = ""
    """The link that is fixed in place of the file's own base."""
    tip: str = ""
    """The link up to which joints move."""
    friction_speed: float = 0.0
    """rad/s or m/s, over which dry friction changes its sign; 0 for none."""
    stop_frequency: float = 0.0
    """Hz, of a joint on its soft stop; 0 for none."""


def select(
    chosen: Selection,
    links: dict[str, Link],
    joints: Sequence[UrdfJoint],
    faults: Remarks,
    warnings: Remarks,
) -> tuple[UrdfJoint, ...]:
    """Return the joints that are left, some of them locked, and take links that are not off."""
    by_name = {joint.name: joint for joint in joints}
    fixed = dict.fromkeys((j.name for j in joints if j.kind == "fixed"), 0.0)
    held, wrong = dict(fixed), Remarks()
    for name, value in chosen.lock.items():
        held |= _locked(name, value, by_name, wrong, warnings)
    for option, link in (("--base-link", chosen.base), ("--tip-link", chosen.tip)):
        if link and link not in links:
            wrong.add(f"{option}: there is no link {quoted(link)}{nearest(link, list(links))}")
    faults.take(wrong)
    if wrong:
        chosen, held = Selection(), fixed
    kept = list(joints)
    if chosen.base:
        inside = _below(chosen.base, joints)
        for name in links.keys() - inside:
            del links[name]
        kept = [joint for joint in joints if joint.parent in inside]
        gone = [j for j in joints if j.parent not in inside and j.mimic is None]
        held |= {j.name: j.rest for j in gone if j.name not in held}
    if chosen.tip:
        held |= _aside(chosen.tip, kept, by_name, held, faults, warnings)
    _follow(held, joints, warnings)
    return tuple(_hold(joint, held[joint.name]) if joint.name in held else joint for joint in kept)


def _locked(
    name: str,
    value: float | None,
    by_name: Mapping[str, UrdfJoint],
    faults: Remarks,
    warnings: Remarks,
) -> dict[str, float]:
    joint = by_name.get(name)
    if joint is None:
        faults.add(f"--lock: there is no joint {quoted(name)}{nearest(name, list(by_name))}")
    elif joint.kind == "fixed":
        faults.add("--lock: is a fixed joint already", "joint", name)
    elif joint.kind in FREE and value is not None:
        text = f"--lock: a {joint.kind} joint is locked where it is, without a value"
        faults.add(text, "joint", name)
    else:
        least, most, _ = joint.limits
        if value is not None and not least <= value <= most:
            unit = "m" if joint.kind == "prismatic" else "rad"
            text = f"--lock: {value:g} {unit} is beyond its limits, {least:g} to {most:g} {unit}"
            warnings.add(text, "joint", name)
        return {name: joint.rest if value is None else value}
    return {}


def _below(base: str, joints: Sequence[UrdfJoint]) -> set[str]:
    below: dict[str, list[str]] = {}
    for joint in joints:
        below.setdefault(joint.parent, []).append(joint.child)
    inside, to_visit = {base}, [base]
    while to_visit:
        children = set(below.get(to_visit.pop(), ())) - inside
        inside |= children
        to_visit += children
    return inside


def _aside(
    tip: str,
    joints: Sequence[UrdfJoint],
    by_name: Mapping[str, UrdfJoint],
    held: Mapping[str, float],
    faults: Remarks,
    warnings: Remarks,
) -> dict[str, float]:
    """Return where the joints are locked that neither move the tip nor lead one that does."""
    above = {joint.child: joint for joint in joints}
    on_the_way: set[str] = set()
    while tip in above and above[tip].name not in on_the_way:
        on_the_way.add(above[tip].name)
        tip = above[tip].parent
    if not on_the_way:
        faults.add("--tip-link: is the base itself, or is not above it", "link", tip)
    moving = {
        name
        for joint in on_the_way
        for name in _leaders(by_name[joint], by_name)
        if name not in held
    }
    aside = {
        joint.name: joint.rest
        for joint in joints
        if joint.mimic is None and joint.name not in held and joint.name not in moving
    }
    if aside:
        names = ", ".join(f"{name} = {value:g}" for name, value in aside.items())
        warnings.add(f"not between base and tip: {plural('joint', len(aside))} locked at {names}")
    return aside


def _leaders(joint: UrdfJoint, by_name: Mapping[str, UrdfJoint]) -> Iterator[str]:
    """Yield a joint's name, that of the joint which it mimics, and so on."""
    seen: set[str] = set()
    at: UrdfJoint | None = joint
    while at is not None and at.name not in seen:
        seen.add(at.name)
        yield at.name
        at = None if at.mimic is None else by_name.get(at.mimic.leader)


def _follow(held: dict[str, float], joints: Sequence[UrdfJoint], warnings: Remarks) -> None:
    """Lock what mimics a locked joint, and what mimics that."""
    following = [joint for joint in joints if joint.mimic is not None]
    for _ in following:
        for joint in following:
            assert joint.mimic is not None
            leader, multiplier, offset = joint.mimic
            if leader in held and joint.name not in held:
                held[joint.name] = multiplier * held[leader] + offset
                text = f"mimics {quoted(leader)}, which is fixed, so it is fixed as well"
                warnings.add(text, "joint", joint.name)


def _hold(joint: UrdfJoint, value: float) -> UrdfJoint:
    """Return a joint as a fixed one at some value, rad or m."""
    origin, along = joint.origin, value * np.array(joint.axis)
    if joint.kind == "prismatic":
        x, y, z = map(float, origin.xyz + multiplied(origin.rotation, along))
        origin = replace(origin, xyz=(x, y, z))
    elif along.any():
        origin = origin.turned(along)
    return UrdfJoint(joint.name, "fixed", joint.parent, joint.child, origin)
