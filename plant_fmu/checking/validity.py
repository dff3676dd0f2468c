"""Whether a model description is as FMI has it: FMPy's judgement, but for structured names.

Structured names (FMI 3.0, section 2.4.7.5.1) are a regular language. FMPy parses each by a general
parser, which takes milliseconds for a name, and for long ones grows faster than their length; here
they are matched, and FMPy is given the description as one whose names are flat.
"""

import re
from collections.abc import Iterator, Sequence
from io import BytesIO
from zipfile import ZipFile

from fmpy.validation import validate_fmu

from nrs_cosim.plant_fmu.archives.archive import Archive
from nrs_cosim.plant_fmu.archives.model_description import NAME
from nrs_cosim.plant_fmu.checking.budget import OutOfTime, limited
from nrs_cosim.plant_fmu.checking.findings import Finding

_VARYING = re.compile(r'"[^"]*"|\d+')
"""What problems of one kind differ in: names of variables, and numbers."""
_CONVENTION = re.compile(rb"(variableNamingConvention\s*=\s*)([\"'])structured\2")
_PART = (
    r"""(?:[A-Za-z_][A-Za-z_0-9]*|'(?:[\w!#$%&()*+,\-./:;<>=?@\[\]^{}|~ ]|\\['"?\\abfnrtv])+')"""
)
_IDENTIFIER = rf"{_PART}(?:\[\d+(?:,\d+)*\])?(?:\.{_PART}(?:\[\d+(?:,\d+)*\])?)*"
_STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,\d+)?\)", re.ASCII)


def validity(archive: Archive, limit: float) -> Iterator[Finding]:
    """Yield the problems of a model description, which alone FMPy is given to parse."""
    alone = BytesIO()
    with ZipFile(archive.path) as source, ZipFile(alone, "w") as target:
        target.writestr(NAME, _CONVENTION.sub(rb"\1\2flat\2", source.read(NAME), count=1))
    try:
        with limited(limit):
            problems = [*_names(archive), *validate_fmu(alone)]
    except OutOfTime:
        text = f"not validated: took longer than {limit:g} s of processor time"
        yield Finding("valid", NAME, "unknown", text)
        return
    for text in _grouped(problems):
        yield Finding("valid", NAME, "note", text)
    if not problems:
        yield Finding("valid", NAME, "holds", f"it is as FMI {archive.fmi_version} has it")


def is_structured(name: str) -> bool:
    """Whether a name is one of the structured naming convention."""
    return _STRUCTURED.fullmatch(name) is not None


def _names(archive: Archive) -> Iterator[str]:
    """Yield the names that are not as the description says that they are."""
    if archive.description.variableNamingConvention != "structured":
        return
    for variable in archive.description.modelVariables:
        if not is_structured(variable.name):
            where = f'Variable "{variable.name}" (line {variable.sourceline})'
            yield f"{where} is not of the structured naming convention."


def _grouped(problems: Sequence[str]) -> Iterator[str]:
    """Yield each problem once, whatever its line and the names in it, with how often it is."""
    kinds: dict[str, list[str]] = {}
    for problem in problems:
        line = " ".join(problem.split())
        kinds.setdefault(_VARYING.sub("", line), []).append(line)
    for first, *more in kinds.values():
        yield f"{first} ({len(more) + 1} times alike)" if more else first
