"""`hinge.c` as an FMU for Model Exchange: a joint with events, whose motion has a closed form."""

import re
import subprocess
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import fmpy

SOURCE = Path(__file__).with_name("hinge.c")
NAMES = ("tau", "q", "qd", "der(q)", "der(qd)", "z", "inertia", "e", "t_load")
SCENES = ("wall", "load", "turn", "end")


def build(fmi: int, folder: Path, nominal: str = "1.0", start: str = "") -> Path:
    """Compile it, with a nominal value of its states, and write its archive.

    With a start q has that after its initialisation, whatever it is told.
    """
    path = folder / f"hinge{fmi}.fmu"
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    with TemporaryDirectory() as work, ZipFile(path, "w") as archive:
        library, stubs = Path(work) / "hinge", Path(work) / "stubs.c"
        stubs.write_text(_stubs(fmi))
        sources = [str(SOURCE), str(stubs)]
        command = [
            "cc",
            f"-DFMI={fmi}",
            f"-DNOMINAL={nominal}",
            *([f"-DSTART={start}"] if start else []),
            "-shared",
            "-fPIC",
            "-O2",
            "-Wall",
            "-Wextra",
            "-Werror",
        ]
        subprocess.run([*command, *sources, "-o", str(library), "-lm"], check=True)
        archive.write(library, f"binaries/{platform}/hinge{fmpy.sharedLibraryExtension}")
        archive.writestr("modelDescription.xml", _description(fmi))
    return path


def _stubs(fmi: int) -> str:
    """Define the calls that FMPy looks for and the hinge has no use for; each fails."""
    header = Path(fmpy.__file__).parent / "c-code" / f"fmi{fmi}Functions.h"
    known = set(re.findall(rf"fmi{fmi}[A-Z]\w+(?=TYPE)", header.read_text()))
    lacking = sorted(known - set(re.findall(rf"fmi{fmi}[A-Z]\w+", SOURCE.read_text())))
    return "".join(f"int {name}(void) {{ return 3; }}\n" for name in lacking)


def _description(fmi: int) -> str:
    return (_fmi2 if fmi == 2 else _fmi3)([*NAMES, *SCENES])


def _attributes(name: str) -> str:
    return {
        "tau": 'causality="input" variability="continuous"',
        "q": 'causality="output" variability="continuous" initial="exact"',
        "qd": 'causality="output" variability="continuous" initial="exact"',
        "der(q)": 'causality="local" variability="continuous" initial="calculated"',
        "der(qd)": 'causality="local" variability="continuous" initial="calculated"',
        "z": 'causality="local" variability="continuous" initial="calculated"',
    }.get(name, 'causality="parameter" variability="fixed" initial="exact"')


def _value(name: str) -> str:
    return {"der(q)": "", "der(qd)": "", "z": ""}.get(name, 'start="0"')


def _fmi2(names: list[str]) -> str:
    derivative = {"der(q)": ' derivative="2"', "der(qd)": ' derivative="3"'}
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" {_attributes(name)}>'
        f"<Real {_value(name)}{derivative.get(name, '')}/></ScalarVariable>"
        for i, name in enumerate(names, 1)
    )
    unknowns = '<Unknown index="4"/><Unknown index="5"/>'
    return (
        '<fmiModelDescription fmiVersion="2.0" modelName="hinge" guid="hinge" '
        'numberOfEventIndicators="1"><ModelExchange modelIdentifier="hinge" '
        'canGetAndSetFMUstate="true" canSerializeFMUstate="true"/>'
        f"<ModelVariables>{variables}</ModelVariables><ModelStructure>"
        f'<Outputs><Unknown index="2"/><Unknown index="3"/></Outputs>'
        f"<Derivatives>{unknowns}</Derivatives><InitialUnknowns>{unknowns}</InitialUnknowns>"
        "</ModelStructure></fmiModelDescription>"
    )


def _fmi3(names: list[str]) -> str:
    derivative = {"der(q)": ' derivative="2"', "der(qd)": ' derivative="3"'}
    variables = "".join(
        f'<Float64 name="{name}" valueReference="{i}" {_attributes(name)} {_value(name)}'
        f"{derivative.get(name, '')}/>"
        for i, name in enumerate(names, 1)
    )
    structure = "".join(
        f'<{kind} valueReference="{reference}"/>'
        for kind, reference in (
            ("Output", 2),
            ("Output", 3),
            ("ContinuousStateDerivative", 4),
            ("ContinuousStateDerivative", 5),
            ("InitialUnknown", 4),
            ("InitialUnknown", 5),
            ("EventIndicator", 6),
        )
    )
    return (
        '<fmiModelDescription fmiVersion="3.0" modelName="hinge" instantiationToken="hinge">'
        '<ModelExchange modelIdentifier="hinge" needsCompletedIntegratorStep="true" '
        'canGetAndSetFMUState="true" canSerializeFMUState="true"/>'
        '<ModelVariables><Float64 name="time" valueReference="0" causality="independent" '
        f'variability="continuous"/>{variables}</ModelVariables>'
        f"<ModelStructure>{structure}</ModelStructure></fmiModelDescription>"
    )
