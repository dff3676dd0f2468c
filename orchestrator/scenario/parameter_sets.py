"""Parameters of an FMU in a file of SSP (.ssv), kept as a table of name, type and value.

System Structure and Parameterization 1.0, section 6. Entries `name[i]` or `name[i,j]` that are all
of one array, counted from 1, are that array; others are scalars by their names. A value is in the
unit of the FMU's variable: a file that gives a unit of its own for one is refused.
"""

import csv
import re
from collections import defaultdict
from collections.abc import Callable
from io import StringIO
from math import prod
from typing import Any

import numpy as np
from lxml import etree

from nrs_cosim.bus.numerals import decimal, whole
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.assets import Asset

NAMESPACE = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
_ELEMENT = re.compile(r"(?P<stem>.+)\[(?P<index>[1-9]\d{0,5}(?:,[1-9]\d{0,5})?)\]")
_TRUTHS = {"true": True, "1": True, "false": False, "0": False}


def parameter_table(data: bytes, name: str) -> bytes:
    """Return a file's table; `ScenarioError` begins with its name."""
    parser = etree.XMLParser(resolve_entities=False, no_network=True, remove_comments=True)
    try:
        root = etree.fromstring(data, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise ScenarioError(f"{name}: not valid XML: {error}") from None
    if root.tag != f"{NAMESPACE}ParameterSet":
        raise ScenarioError(f"{name}: expected a ParameterSet of SSP 1.0, got {quoted(root.tag)}")
    text = StringIO()
    out = csv.writer(text, lineterminator="\n")
    known: set[str] = set()
    for parameter in root.iterfind(f"{NAMESPACE}Parameters/{NAMESPACE}Parameter"):
        called = parameter.get("name") or ""
        given = [one for one in parameter if isinstance(one.tag, str)]
        kind = given[0].tag.removeprefix(NAMESPACE) if given else ""
        value = given[0].get("value") if given else None
        if called in known or not called:
            raise ScenarioError(f"{name}: parameter {quoted(called)}: expected a name, once")
        if kind not in _READ or value is None:
            raise ScenarioError(
                f"{name}: parameter {quoted(called)}: expected a value of {', '.join(_READ)}"
            )
        if unit := given[0].get("unit"):
            raise ScenarioError(
                f"{name}: parameter {quoted(called)}: is in {quoted(unit)}; give it in the unit of "
                "the FMU's variable, without one"
            )
        known.add(called)
        _read(kind, value, f"{name}: parameter {quoted(called)}")
        out.writerow([called, kind, value])
    return text.getvalue().encode()


def read_parameters(asset: Asset) -> dict[str, Any]:
    """Return the parameters of a table, arrays whole."""
    rows = csv.reader(StringIO(asset.content.decode()))
    scalars = {name: _read(kind, value, asset.name) for name, kind, value in rows}
    arrays: defaultdict[str, dict[tuple[int, ...], str]] = defaultdict(dict)
    for name in scalars:
        if match := _ELEMENT.fullmatch(name):
            arrays[match["stem"]][tuple(map(int, match["index"].split(",")))] = name
    for stem, names in arrays.items():
        shape = tuple(np.max(list(names), axis=0)) if len({*map(len, names)}) == 1 else ()
        if shape and prod(shape) == len(names) and stem not in scalars:
            values = [scalars.pop(names[index]) for index in sorted(names)]
            width = shape[-1]
            rows_of = [tuple(values[at : at + width]) for at in range(0, len(values), width)]
            scalars[stem] = tuple(rows_of) if len(shape) > 1 else rows_of[0]
    return scalars


def _read(kind: str, value: str, where: str) -> Any:
    try:
        return _READ[kind](value.strip() if kind != "String" else value)
    except (ValueError, KeyError):
        raise ScenarioError(f"{where}: expected a value of {kind}, got {quoted(value)}") from None


def _finite(text: str) -> float:
    number = decimal(text)
    if not np.isfinite(number):
        raise ValueError(text)
    return number


_READ: dict[str, Callable[[str], Any]] = {
    "Real": _finite,
    "Integer": whole,
    "Boolean": _TRUTHS.__getitem__,
    "Enumeration": str,
    "String": str,
}
