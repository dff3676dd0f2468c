"""What xacro left in a URDF file: harmless, or a sign that the file was never expanded.

Generated files may still hold calls of macros that are gone, definitions, and whole blocks beside
the dynamics. A directive matters where a link, a joint or a part of one could come of it.
"""

import re
from collections.abc import Iterator, Mapping

from lxml import etree

from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.bundled.urdf_xml import Element, prefix
from nrs_cosim.plant_fmu.errors import FmuError

_NAMESPACE = re.compile(r"\{http://(www\.)?(ros\.org/wiki|wiki\.ros\.org)/xacro(#interface)?/?\}")
_PARTS = {
    "link": {"inertial"},
    "joint": {"origin", "parent", "child", "axis", "dynamics", "mimic"},
    "inertial": {"origin", "mass", "inertia"},
}
"""Of what a robot's dynamics is read, and what of each of them."""
_ALL_PARTS = set(_PARTS).union(*_PARTS.values())
_DEFINITIONS = {"property", "arg", "macro"}
_OPEN = {"include", "insert_block", "call", "element", "attribute"}
"""Directives of which anything may come."""
_EXPAND = "is a xacro file; expand it first: xacro robot.urdf.xacro > robot.urdf"
_EXPRESSION = re.compile(r"\$[({]")


def expect_expanded(root: Element, warnings: Remarks) -> None:
    """Raise `FmuError` where the dynamics need what xacro has not expanded; warn of the rest."""
    macros = {
        element.get("name", ""): element
        for element in root.iter(etree.Element)
        if _directive(element) == "macro"
    }
    if macros and root.find("link") is None:
        raise FmuError(_EXPAND)
    for element in _read(root):
        if _EXPRESSION.search(" ".join(element.values())) or any(
            _matters(child, macros, frozenset()) for child in element
        ):
            raise FmuError(_EXPAND)
    left = dict.fromkeys(filter(None, map(_directive, root.iter(etree.Element))))
    if left:
        names = ", ".join(f"<xacro:{name}>" for name in left)
        warnings.add(f"{names} of xacro is left in it, and left out of the dynamics")


def _read(root: Element) -> Iterator[Element]:
    """Yield the robot, and the elements that its dynamics is read of."""
    yield root
    for tag in ("link", "joint"):
        for element in root.findall(tag):
            yield element
            for part in _PARTS[tag]:
                for there in element.findall(part):
                    yield there
                    if part == "inertial":
                        yield from (e for name in _PARTS[part] for e in there.findall(name))


def _matters(element: Element, macros: Mapping[str, Element], within: frozenset[str]) -> bool:
    """Whether a directive that stands among what is read could give more of it."""
    name = _directive(element)
    if not name or name in _DEFINITIONS:
        return False
    if name in _OPEN:
        return True
    if name in {"if", "unless"}:
        body = element
    elif name in macros and name not in within:
        body, within = macros[name], within | {name}
    else:  # a macro that is gone
        return False
    return any(
        inner.tag in _ALL_PARTS or _matters(inner, macros, within)
        for inner in body.iterchildren(etree.Element)
    )


def _directive(element: Element) -> str:
    """Return the name of an element of xacro without its prefix; nothing for others."""
    if not isinstance(element.tag, str):
        return ""
    if (declared := _NAMESPACE.match(element.tag)) is not None:
        return element.tag[declared.end() :]
    return element.tag.removeprefix("xacro:") if prefix(element.tag) == "xacro" else ""
