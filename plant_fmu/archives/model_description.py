"""modelDescription.xml of a stranger: parsed without entities or network, then read by FMPy.

FMPy does not ask it to be valid, since tools write descriptions that are not, and yet run; only
what the rest of this package relies on is asked for.
"""

import re
from collections.abc import Iterator
from io import BytesIO
from typing import Any
from zipfile import ZipFile

import fmpy
from fmpy.model_description import ModelDescription
from lxml import etree

from nrs_cosim.bus.text import quoted
from nrs_cosim.plant_fmu.errors import FmuError

NAME = "modelDescription.xml"
MOST_BYTES = 64 << 20
MOST_REFERENCE = (1 << 32) - 1
_SCALARS = ("1.0", "2.0")
"""The versions in which a variable's type is an element in it."""
_TYPES = {
    **{major: {"Real", "Integer", "Boolean", "String", "Enumeration"} for major in "12"},
    "3": {"Boolean", "String", "Binary", "Enumeration", "Clock", "Float32", "Float64"}
    | {f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)},
}


def read_description(archive: ZipFile, label: str) -> ModelDescription:
    """Read the model description in an archive; `FmuError` with cause and line when it cannot."""
    try:
        entry = archive.getinfo(NAME)
    except KeyError:
        raise FmuError(f"{label}: is not an FMU: it has no {NAME}") from None
    if entry.file_size > MOST_BYTES:
        raise FmuError(f"{label}: its {NAME} is larger than {MOST_BYTES >> 20} MiB")
    text = archive.read(entry)
    try:
        root = etree.fromstring(text, _parser())
    except etree.XMLSyntaxError as error:
        cause = " ".join(error.msg.split())
        raise FmuError(f"{label}: its {NAME} is not valid XML: {cause}") from None
    if fault := next(_faults(root), None):
        raise FmuError(f"{label}: its {NAME} cannot be used: {fault}")
    try:
        return fmpy.read_model_description(_alone(text), validate=False)
    except Exception as error:  # FMPy raises what its code ran into
        own = str(error) if type(error) is Exception else "FMPy cannot read it"
        cause = next(_dangling(root), None) or _first_problem(text) or own
        raise FmuError(f"{label}: its {NAME} cannot be used: {cause}") from None


def _parser() -> etree.XMLParser:
    return etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=False)


def _faults(root: Any) -> Iterator[str]:
    """Yield what keeps a description from being read, or from meaning what it says."""
    version = root.get("fmiVersion", "")
    if root.getroottree().docinfo.doctype:
        yield "it has a document type declaration, which FMI does not know"
    if root.tag != "fmiModelDescription":
        yield f"it is a {root.tag}, expected fmiModelDescription"
    if not re.fullmatch(r"[12]\.0|3\.\d+", version):
        known = "FMI 2.0 and 3.0 can be run, and 1.0 be read"
        yield f"it is of FMI {version or 'without version'}; {known}"
    types = _TYPES[version[0]]
    for variable in root.iterfind("ModelVariables/*"):
        here = f"line {variable.sourceline}: variable {quoted(variable.get('name'))}"
        given = variable.iterchildren(etree.Element) if version in _SCALARS else [variable]
        if not any(element.tag in types for element in given):
            yield f"{here} has no type of FMI {version}"
        reference = variable.get("valueReference", "")
        if not re.fullmatch(r"\s*\d{1,10}\s*", reference) or int(reference) > MOST_REFERENCE:
            yield f"{here} has the value reference {quoted(reference)}"


def _dangling(root: Any) -> Iterator[str]:
    """Yield which elements refer to variables that are not there."""
    if root.find("ModelVariables") is None:
        yield "it has no ModelVariables"
    variables = root.findall("ModelVariables/*")
    attributes = ["dependencies", "derivative"]
    if root.get("fmiVersion") == "2.0":
        known = set(map(str, range(1, len(variables) + 1)))
        what = "variable no."
        attributes += ["index"]
    else:
        known = {variable.get("valueReference", "").strip() for variable in variables}
        what = "the value reference"
        attributes += ["valueReference", "clocks"]
    for element in root.iterfind(".//*"):
        for attribute in attributes:
            for reference in (element.get(attribute) or "").split():
                if reference not in known:
                    yield (
                        f"line {element.sourceline}: {attribute} of {element.tag} names {what} "
                        f"{reference}, but there is none"
                    )


def _alone(text: bytes) -> BytesIO:
    """Return an archive with nothing but a model description, so that FMPy parses nothing else."""
    file = BytesIO()
    with ZipFile(file, "w") as archive:
        archive.writestr(NAME, text)
    return file


def _first_problem(text: bytes) -> str | None:
    """Return the first fault that FMI's schema finds, with its line."""
    try:
        fmpy.read_model_description(_alone(text))
    except Exception as error:  # FMPy raises what its code ran into
        problems = getattr(error, "problems", [])
        return str(problems[0]) if problems else None
    return None
