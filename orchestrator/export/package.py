"""A system as an SSP: a zip of FMUs, their parameters, and an XML of how they are connected.

System Structure and Parameterization 1.0: SystemStructure.ssd names components, connectors and
connections, and for each component the .ssv file of its parameters. It has no step, which is in an
annotation that libcosim reads. The right answers are beside it, and what to do to have them. The
same system is the same bytes. Prefixes are spelled as in the standard: engines look for these.
"""

from collections.abc import Iterable, Mapping
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from nrs_cosim.orchestrator.export.system import Component, System
from nrs_cosim.plant_fmu.bundled.builder import archive_bytes

SSP1 = "http://ssp-standard.org/SSP1/SystemStructure"
NAMESPACES = {
    "xmlns:ssd": f"{SSP1}Description",
    "xmlns:ssc": f"{SSP1}Common",
    "xmlns:ssv": f"{SSP1}ParameterValues",
}
OSP = "http://opensimulationplatform.com/SSP/OSPAnnotations"
SET = "initial"
"""What each component's set of parameters is called, for engines that ask which one to take."""
EXTRA = "extra/nrs-cosim"
ANSWERS = f"{EXTRA}/reference.csv"


def ssp_bytes(system: System, answers: str) -> bytes:
    """Return a system as an SSP, with the table of what engines must come to."""
    fmus = _fmu_names(system.components)
    every = {
        f"{component.name}.{name}": value
        for component in system.components
        for name, value in component.parameters.items()
    }
    sets = {f"resources/{c.name}.ssv": _parameter_set(c.parameters) for c in system.components}
    return archive_bytes(
        {
            "SystemStructure.ssd": _structure(system, fmus),
            **{f"resources/{fmus[c.name]}": c.fmu.read_bytes() for c in system.components},
            **sets,
            "resources/all.ssv": _parameter_set(every),
            ANSWERS: answers.encode(),
            f"{EXTRA}/README.md": _readme(system).encode(),
        }
    )


def _fmu_names(components: Iterable[Component]) -> dict[str, str]:
    """Return the name of each component's FMU; those of one FMU share it."""
    names: dict[str, str] = {}
    taken: dict[str, str] = {}
    for component in components:
        stem = component.fmu.stem.partition("-")[0]
        if str(component.fmu) not in taken:
            alike = sum(name.startswith(f"{stem}-") for name in taken.values())
            taken[str(component.fmu)] = f"{stem}-{alike + 1}.fmu"
        names[component.name] = taken[str(component.fmu)]
    return names


def _structure(system: System, fmus: Mapping[str, str]) -> bytes:
    about = {"version": "1.0", "name": system.name, **NAMESPACES, "xmlns:osp": OSP}
    root = Element("ssd:SystemStructureDescription", about)
    inner = SubElement(root, "ssd:System", name="network")
    elements = SubElement(inner, "ssd:Elements")
    for component in system.components:
        _component(elements, component, fmus[component.name])
    connections = SubElement(inner, "ssd:Connections")
    for source, output, sink, given in system.connections:
        ends = {"startElement": source, "startConnector": output, "endElement": sink}
        SubElement(connections, "ssd:Connection", {**ends, "endConnector": given})
    experiment = SubElement(
        root, "ssd:DefaultExperiment", startTime="0.0", stopTime=repr(system.end)
    )
    annotations = SubElement(experiment, "ssd:Annotations")
    annotation = SubElement(annotations, "ssc:Annotation", type="com.opensimulationplatform")
    algorithm = SubElement(annotation, "osp:Algorithm")  # libcosim takes no attribute here
    SubElement(algorithm, "osp:FixedStepAlgorithm", baseStepSize=repr(system.step))
    return _bytes(root)


def _component(elements: Element, component: Component, fmu: str) -> None:
    about = {"name": component.name, "type": "application/x-fmu-sharedlibrary"}
    element = SubElement(elements, "ssd:Component", {**about, "source": f"resources/{fmu}"})
    connectors = SubElement(element, "ssd:Connectors")
    for kind, names in (("input", component.inputs), ("output", component.outputs)):
        for name in names:
            connector = SubElement(connectors, "ssd:Connector", name=name, kind=kind)
            SubElement(connector, "ssc:Real")
    bindings = SubElement(element, "ssd:ParameterBindings")
    bound = {"type": "application/x-ssp-parameter-set"}
    bound["source"] = f"resources/{component.name}.ssv"
    SubElement(bindings, "ssd:ParameterBinding", bound)


def _parameter_set(parameters: Mapping[str, float]) -> bytes:
    root = Element("ssv:ParameterSet", {"version": "1.0", "name": SET, **NAMESPACES})
    entries = SubElement(root, "ssv:Parameters")
    for name, value in parameters.items():
        SubElement(SubElement(entries, "ssv:Parameter", name=name), "ssv:Real", value=repr(value))
    return _bytes(root)


def _bytes(root: Element) -> bytes:
    indent(root)
    text: bytes = tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def _readme(system: System) -> str:
    digits = (
        "to the last bit"
        if system.exact
        else "but for rounding, by which K and G are not quite the algorithm's own jump"
    )
    return f"""# {system.name}

Robots that sample one another and a target. Each FMU is a robot with its estimator agent, which
jumps at the beginning of a step from a sampling time; one exchange of outputs a step, after all
FMUs were stepped, is what they need. A component's `position` and `velocity` are its sample.

`reference.csv` has what was recorded at the sampling times: the samples, as left limits, and the
robots' `q` and `qd`. Every engine must come to these numbers, {digits}, with steps of
{system.step!r} s. A step past a sampling time is refused, and outputs are NaN from then on.

    # ecos (ecospy, tbb): parameter sets are applied by their name
    with EcosSimulation(ssp_path="this.ssp", step_size={system.step!r}) as simulation:
        simulation.init(parameter_set="{SET}")
        simulation.step()
        simulation.get_real("robot_1::q[1]")

    # libcosim (libcosimpy): it unpacks the SSP itself, and has the step from an annotation
    execution = CosimExecution.from_ssp_file("this.ssp")
    execution.step()

    # FMPy: it takes one set for all; first unzip this.ssp resources/all.ssv
    simulate_ssp("this.ssp", stop_time={system.end!r}, step_size={system.step!r},
                 parameter_set=read_ssv("resources/all.ssv"))
"""
