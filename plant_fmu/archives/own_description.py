"""modelDescription.xml of FMI 3.0 as this package writes it, read without FMPy.

FMPy and what it parses with take longer to load than all that is asked of a bundled model. The
records here have FMPy's names, and its values, of whatever is read of a description anywhere, so
that nobody need know who read it.
"""

from collections.abc import Mapping
from math import prod
from types import SimpleNamespace as Record
from typing import Any
from xml.etree.ElementTree import Element, fromstring
from zipfile import ZipFile

from nrs_cosim.plant_fmu.archives.records import ModelDescription

_BASE_UNIT = {**dict.fromkeys(("kg", "m", "s", "A", "K", "mol", "cd", "rad"), 0), "factor": 1.0}
_NOT_GIVEN = dict.fromkeys(("unit", "min", "max", "nominal", "start", "derivative"))
"""Of a variable: what it need not have."""
_NEVER_GIVEN = dict.fromkeys(("alias", "clocks", "declaredType", "intervalVariability", "quantity"))
_INITIAL = {"independent": None, "input": "exact"}
"""Where FMI does not let it be given."""


def read_own_description(archive: ZipFile, _label: str) -> ModelDescription:
    """Return what `bundled.model_description` wrote, as FMPy would."""
    root = fromstring(archive.read("modelDescription.xml"))
    elements = root.findall("ModelVariables/*")
    variables = {int(e.attrib["valueReference"]): _variable(e) for e in elements}
    for element, variable in zip(elements, variables.values(), strict=True):
        if variable.derivative is not None:
            variable.derivative = variables[int(variable.derivative)]
        variable.dimensions = [_dimension(one, variables) for one in element]
        variable.shape = tuple(
            int(one.start if one.variable is None else one.variable.start)
            for one in variable.dimensions
        )
    unknowns = {
        ours: [_unknown(element, variables) for element in root.iterfind(f"ModelStructure/{name}")]
        for ours, name in (
            ("outputs", "Output"),
            ("derivatives", "ContinuousStateDerivative"),
            ("initialUnknowns", "InitialUnknown"),
        )
    }
    return Record(
        **root.attrib,
        fmiMajorVersion=3,
        coSimulation=_interface(root.find("CoSimulation")),
        modelExchange=_interface(root.find("ModelExchange")),
        scheduledExecution=None,
        defaultExperiment=_record(root.find("DefaultExperiment")),
        unitDefinitions=[_unit(element) for element in root.iterfind("UnitDefinitions/Unit")],
        modelVariables=[*variables.values()],
        numberOfContinuousStates=sum(prod(d.variable.shape) for d in unknowns["derivatives"]),
        numberOfEventIndicators=0,
        buildConfigurations=[],
        **unknowns,
    )


def _record(element: Element | None) -> Record | None:
    return None if element is None else Record(**element.attrib)


def _interface(element: Element | None) -> Record | None:
    if element is None:
        return None
    given = {key.replace("FMUState", "FMUstate"): value for key, value in element.items()}
    name = given.pop("modelIdentifier")
    flags = {key: value == "true" for key, value in given.items()}
    return Record(modelIdentifier=name, fixedInternalStepSize=None, **flags)


def _unit(element: Element) -> Record:
    base = {key: int(value) for one in element for key, value in one.items()}
    return Record(name=element.get("name"), baseUnit=Record(**_BASE_UNIT | base, offset=0.0))


def _variable(element: Element) -> Record:
    given: dict[str, Any] = {**_NEVER_GIVEN, **_NOT_GIVEN, **element.attrib, "type": element.tag}
    if element.tag != "Float64":  # of which alone FMPy keeps them
        given |= {"min": None, "max": None}
    given.setdefault("initial", _INITIAL.get(given["causality"]))
    return Record(**given | {"valueReference": int(given["valueReference"])})


def _dimension(element: Element, variables: Mapping[int, Record]) -> Record:
    numbers = {key: int(value) for key, value in element.items()}
    by = numbers.get("valueReference")
    return Record(
        start=numbers.get("start"),
        valueReference=by,
        variable=None if by is None else variables[by],
    )


def _unknown(element: Element, variables: Mapping[int, Record]) -> Record:
    given = element.get("dependencies")
    return Record(
        index=0,
        variable=variables[int(element.attrib["valueReference"])],
        dependencies=None if given is None else [variables[int(by)] for by in given.split()],
    )
