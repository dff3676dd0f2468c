"""A motor's rotor of inertia J that turns n times as fast as its joint is J n² to the joint.

It is added to the joint's own inertia; that the rotor's axis turns with the robot is left out.
URDF's `<transmission>` has no rotor by itself: `rotor_inertia` beside `gear_ratio` is Drake's
extension, and some files have it beside URDF's `mechanicalReduction`.
"""

from collections.abc import Mapping
from math import nan

from nrs_cosim.bus.numerals import decimal
from nrs_cosim.bus.text import nearest, quoted
from nrs_cosim.plant_fmu.bundled.urdf_elements import LARGEST
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_robot import UrdfJoint
from nrs_cosim.plant_fmu.bundled.urdf_xml import Element

_INERTIA = {"rotor_inertia", "rotorInertia", "motorInertia"}
_RATIO = {"gear_ratio", "mechanicalReduction", "mechanical_reduction"}


def reflected_inertias(
    root: Element, known: Mapping[str, UrdfJoint], faults: Remarks, warnings: Remarks
) -> dict[str, float]:
    """Return the inertia by joint, in kg m2 or kg, of those that have a rotor.

    A rotor of no joint that is known is a fault, and a transmission without one a warning.
    """
    found: dict[str, float] = {}
    for transmission in root.findall("transmission"):
        name = transmission.get("name", "").strip()
        joints = [joint.get("name", "").strip() for joint in transmission.findall("joint")]
        missing = [joint for joint in joints if joint not in known]
        nowhere = ", ".join(f"{quoted(joint)}{nearest(joint, list(known))}" for joint in missing)
        has_rotor = False
        for actuator in transmission.findall("actuator"):
            inertia = _number((actuator,), _INERTIA, 0.0, faults)
            ratio = _number((actuator, transmission), _RATIO, 1.0, faults)
            has_rotor |= inertia > 0.0
            if inertia and len(joints) == 1:
                found[joints[0]] = found.get(joints[0], 0.0) + inertia * ratio**2
            elif inertia:
                text = f"has a rotor, and so one joint is expected, got {len(joints)}"
                faults.add(text, "transmission", name)
        if missing and has_rotor:
            text = f"has a rotor, and there is no joint {nowhere}"
            faults.add(text, "transmission", name)
        elif missing:
            warnings.add(f"there is no joint {nowhere}", "transmission", name)
        if has_rotor and any(known[one].kind == "fixed" for one in joints if one in known):
            warnings.add("its rotor is left out, for its joint is fixed", "transmission", name)
    return found


def _number(places: tuple[Element, ...], names: set[str], default: float, faults: Remarks) -> float:
    """Return the number of the first element of such a name, whose prefix is anybody's."""
    for element in (element for place in places for element in place.iter()):
        tag = str(element.tag).rpartition("}")[2].rpartition(":")[2]
        text = element.get("value") or element.text or ""
        if tag not in names:
            continue
        try:
            number = decimal(text.strip())
        except ValueError:
            number = nan
        if abs(number) <= LARGEST and (number >= 0.0 or names is _RATIO):
            return number
        faults.add(f"<transmission> <{tag}>: expected a number, got {quoted(text)}")
    return default
