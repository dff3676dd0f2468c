"""A declaration as modelDescription.xml, for FMI 2.0 and 3.0, always the same bytes."""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import version
from itertools import product
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from nrs_cosim.plant_fmu.bundled.declaration import Declaration, Variable
from nrs_cosim.plant_fmu.unit_names import parse_unit

ORIGIN = {
    "author": "the nrs-cosim authors",
    "version": version("nrs-cosim"),
    "copyright": "the nrs-cosim authors",
    "license": "MIT",
}


def model_description(
    model: Declaration, fmi: int, token: str, source_files: Sequence[str]
) -> bytes:
    """modelDescription.xml of `model` for FMI `fmi`, 2 or 3 (FMI 3.0.2, section 2.4).

    `token` identifies the binary (FMI 2: guid); `source_files` are the C files that make
    it, which FMI 2 lists here, and FMI 3 in buildDescription.xml.
    """
    root = Element(
        "fmiModelDescription",
        {
            "fmiVersion": f"{fmi}.0",
            "modelName": model.name,
            "guid" if fmi == 2 else "instantiationToken": token,
            "description": model.description,
            **ORIGIN,
            "generationTool": "nrs-cosim",
            "variableNamingConvention": "structured",
        },
    )
    for interface in model.interfaces:
        element = SubElement(root, interface, _capabilities(model.name, interface, fmi))
        if fmi == 2:
            files = SubElement(element, "SourceFiles")
            for name in source_files:
                SubElement(files, "File", name=name)
    _units(root, model)
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="why a call failed")
    experiment = {"startTime": "0", "stopTime": "10", "tolerance": "1e-9", "stepSize": "0.1"}
    SubElement(root, "DefaultExperiment", experiment)
    if fmi == 2:
        _scalars(root, model)
    else:
        _arrays(root, model)
    return _bytes(root)


def build_description(model: Declaration, source_files: Sequence[str]) -> bytes:
    """sources/buildDescription.xml (FMI 3.0.2, section 2.5.1.3)."""
    root = Element("fmiBuildDescription", fmiVersion="3.0")
    configuration = SubElement(root, "BuildConfiguration", modelIdentifier=model.name)
    files = SubElement(configuration, "SourceFileSet", language="C99")
    for name in source_files:
        SubElement(files, "SourceFile", name=name)
    SubElement(configuration, "Library", name="m", external="true", description="C mathematics")
    return _bytes(root)


def element_names(variable: Variable) -> tuple[str, ...]:
    """The names of its numbers, row-major: `kp[1,2]`, `der(q[1])` (FMI 2.0.4, 2.2.9)."""
    if not variable.shape:
        return (variable.name,)
    template = re.sub(r"(\w+)(\)?)$", r"\1[{}]\2", variable.name)
    indices = product(*(range(1, length + 1) for length in variable.shape))
    return tuple(template.format(",".join(map(str, index))) for index in indices)


def _bytes(root: Element) -> bytes:
    indent(root)
    text: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _capabilities(identifier: str, interface: str, fmi: int) -> dict[str, str]:
    state = "FMUstate" if fmi == 2 else "FMUState"
    common = {
        "modelIdentifier": identifier,
        "needsExecutionTool": "false",
        "canBeInstantiatedOnlyOncePerProcess": "false",
        f"canGetAndSet{state}": "true",
        f"canSerialize{state}": "true",
    }
    if fmi == 2:
        common["canNotUseMemoryManagementFunctions"] = "true"
    if interface == "CoSimulation":
        return {**common, "canHandleVariableCommunicationStepSize": "true"}
    if fmi == 2:
        return {**common, "completedIntegratorStepNotNeeded": "true"}
    return {**common, "needsCompletedIntegratorStep": "false"}


def _units(root: Element, model: Declaration) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for unit in sorted({v.unit for v in model.variables if v.unit is not None}):
        SubElement(SubElement(definitions, "Unit", name=unit), "BaseUnit", _base_unit(unit))


def _base_unit(name: str) -> dict[str, str]:
    """The exponents of a unit that a declaration names, where they are not 0."""
    unit = parse_unit(name)
    if unit is None or unit.factor != 1:
        raise ValueError(f"{name!r}: expected a product of SI units, such as kg.m2 or N.m.s/rad")
    bases = zip(("kg", "m", "s", "rad"), unit.exponents, strict=True)
    return {base: str(exponent) for base, exponent in bases if exponent}


def _attributes(variable: Variable, name: str, reference: int) -> dict[str, str]:
    attributes = {
        "name": name,
        "valueReference": str(reference),
        "causality": variable.causality,
        "variability": variable.variability,
        "description": variable.description,
    }
    if variable.initial is not None:
        attributes["initial"] = variable.initial
    return attributes


def _set_numbers(element: Element, variable: Variable, starts: Sequence[float]) -> None:
    """The attributes of Real and Float64 that are numbers; the limits hold for each element."""
    if variable.unit is not None:
        element.set("unit", variable.unit)
    for limit in ("min", "max"):
        if (value := getattr(variable, limit)) is not None:
            element.set(limit, repr(float(value)))
    if variable.nominal != 1.0 or variable.kind == "state":
        element.set("nominal", repr(variable.nominal))
    if starts:
        element.set("start", " ".join(map(repr, starts)))


def _arrays(root: Element, model: Declaration) -> None:
    """FMI 3: one element per variable, and ModelStructure by value reference."""
    variables = SubElement(root, "ModelVariables")
    for v in model.variables:
        attributes = _attributes(v, v.name, v.value_reference)
        if v.kind == "structural":
            limits = {"min": "1", "max": str(v.most), "start": f"{v.starts[0]:.0f}"}
            SubElement(variables, "UInt64", {**attributes, **limits})
            continue
        element = SubElement(variables, "Float64", attributes)
        _set_numbers(element, v, v.starts[: v.size])
        if v.derivative_of and v.kind == "derivative":
            element.set("derivative", str(model.variable(v.derivative_of).value_reference))
        for dimension in v.dimensions:
            if dimension.by is None:
                SubElement(element, "Dimension", start=str(dimension.start))
            else:
                by = model.variable(dimension.by).value_reference
                SubElement(element, "Dimension", valueReference=str(by))

    structure = SubElement(root, "ModelStructure")
    for tag, unknowns in _unknowns(model):
        for v in unknowns:
            known = _known(model, v)
            dependencies = {} if known is None else {known.value_reference: "constant"}
            SubElement(structure, tag, _unknown("valueReference", v.value_reference, dependencies))


def _scalars(root: Element, model: Declaration) -> None:
    """FMI 2: one Real per element, and ModelStructure by index, which is counted from 1."""
    variables = SubElement(root, "ModelVariables")
    for v in model.variables:
        for i, name in enumerate(element_names(v)):
            attributes = _attributes(v, name, v.value_reference + i)
            element = SubElement(SubElement(variables, "ScalarVariable", attributes), "Real")
            _set_numbers(element, v, v.starts[i : i + 1])
            if v.derivative_of and v.kind == "derivative":
                state = model.variable(v.derivative_of)
                element.set("derivative", str(state.value_reference + i + 1))

    structure = SubElement(root, "ModelStructure")
    tags = {
        "Output": "Outputs",
        "ContinuousStateDerivative": "Derivatives",
        "InitialUnknown": "InitialUnknowns",
    }
    for tag, unknowns in _unknowns(model):
        group = None
        for v in unknowns:
            group = SubElement(structure, tags[tag]) if group is None else group
            known = _known(model, v)
            for i in range(v.size):
                dependencies = {} if known is None else {known.value_reference + i + 1: "constant"}
                if tag == "Output" and known is None:
                    dependencies = dict.fromkeys(_knowns(model, v, i), "dependent")
                index = v.value_reference + i + 1
                SubElement(group, "Unknown", _unknown("index", index, dependencies))


def _unknowns(model: Declaration) -> Iterator[tuple[str, Iterable[Variable]]]:
    yield "Output", model.of_kind("state", "output")
    yield "ContinuousStateDerivative", model.of_kind("derivative")
    starting = (v for v in model.of_kind("state") if v.start is None)
    yield "InitialUnknown", (*starting, *model.of_kind("derivative", "output"))


def _known(model: Declaration, variable: Variable) -> Variable | None:
    """The one variable on which it depends, by a constant factor; None for many."""
    if variable.kind == "state":
        return variable
    return None if variable.equals is None else model.variable(variable.equals)


def _knowns(model: Declaration, output: Variable, i: int) -> Iterator[int]:
    """The indices of the scalars on which element i of an output depends: of those in `each_of`
    its own alone, and of what changes by steps alone on no input."""
    kinds = () if output.stepped else ("input", "state")
    for v in model.of_kind("independent", *kinds):
        own = (i,) if v.name in output.each_of else range(v.size)
        yield from (v.value_reference + j + 1 for j in own)


def _unknown(key: str, number: int, dependencies: Mapping[int, str]) -> dict[str, str]:
    """All that is known may count where no dependencies are given."""
    if not dependencies:
        return {key: str(number)}
    return {
        key: str(number),
        "dependencies": " ".join(map(str, dependencies)),
        "dependenciesKind": " ".join(dependencies.values()),
    }
