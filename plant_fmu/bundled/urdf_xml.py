"""The XML of a URDF file, read as leniently as the parsers do that robots are written for.

Those know nothing of namespaces: `link` is a link in whatever namespace, and `prefix:link` is none,
whether or not the prefix is declared. They take blanks before the XML declaration, and bytes in
comments that are of another encoding. All this is warned of. What is not well-formed otherwise is
refused, and so are document types: no entity is expanded, and nothing is fetched.
"""

from codecs import BOM_UTF8
from pathlib import Path
from typing import Any

from lxml import etree

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.bundled.urdf_remarks import Remarks
from nrs_cosim.plant_fmu.errors import FmuError

Element = Any
"""An element of lxml, which has no types."""

MOST_BYTES = 64 << 20
_WRONG_ENCODING = "ERR_INVALID_ENCODING"
_BEARABLE = {"ERR_HYPHEN_IN_COMMENT"}


def read_xml(path: Path, warnings: Remarks) -> Element:
    """Return the root, its elements named as they are written; `FmuError` says what is wrong."""
    try:
        with path.open("rb") as file:
            text = file.read(MOST_BYTES + 1)
    except OSError as error:
        raise FmuError(f"cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise FmuError(f"cannot be read: {error}") from None
    if len(text) > MOST_BYTES:
        raise FmuError(f"is larger than {MOST_BYTES >> 20} MiB")
    root = _parse(_from_the_declaration(text, warnings), warnings)
    if root.getroottree().docinfo.internalDTD is not None:
        raise FmuError("has a document type declaration, which URDF does not know; remove it")
    _name_as_written(root, warnings)
    return root


def prefix(name: str) -> str:
    """Return what is before the colon of an element's or attribute's name; nothing if undeclared.

    A name whose prefix is declared has the namespace in braces instead.
    """
    return "" if name.startswith("{") else name.rpartition(":")[0]


def _from_the_declaration(text: bytes, warnings: Remarks) -> bytes:
    """Cut off what is blank before an XML declaration, which must be the first of a file."""
    declared = text.removeprefix(BOM_UTF8).lstrip()
    if not declared.startswith(b"<?xml") or text.removeprefix(BOM_UTF8) == declared:
        return text
    warnings.add("there are blanks before its XML declaration")
    return declared


def _parse(text: bytes, warnings: Remarks, encoding: str | None = None) -> Element:
    parser = etree.XMLParser(
        recover=True,  # which passes over all faults, so that each is judged here
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        huge_tree=False,
        remove_comments=True,
        remove_pis=True,
        encoding=encoding,
    )
    try:
        root = etree.fromstring(text, parser)
    except etree.XMLSyntaxError as error:
        raise FmuError(f"is no XML: {error.msg}") from None
    faults = [fault for fault in parser.error_log if fault.level == etree.ErrorLevels.FATAL]
    if encoding is None and any(fault.type_name == _WRONG_ENCODING for fault in faults):
        warnings.add("has bytes that are not of its encoding; it is read as Latin-1")
        return _parse(text, warnings, "iso-8859-1")
    for fault in faults:
        if fault.type_name not in _BEARABLE:
            where = f"line {fault.line}, column {fault.column}"
            raise FmuError(f"is no XML: {' '.join(fault.message.split())}: {where}")
    return root


def _name_as_written(root: Element, warnings: Remarks) -> None:
    """Take elements without a prefix out of their namespace; warn of prefixes without one."""
    undeclared: dict[str, None] = {}
    for element in root.iter(etree.Element):
        if element.prefix is None and element.tag.startswith("{"):
            name = etree.QName(element)
            warnings.add(f"its default namespace {name.namespace} is ignored")
            element.tag = name.localname
        undeclared |= dict.fromkeys(filter(None, map(prefix, (element.tag, *element.keys()))))
    for name in undeclared:
        warnings.add(
            f"the prefix {quoted(name)} is declared nowhere; what bears it is left out of the "
            "dynamics"
        )
