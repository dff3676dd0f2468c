"""`talker.c` as an FMU for Co-Simulation: it logs and frees by what it was given, to its end."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import fmpy

SOURCE = Path(__file__).with_name("talker.c")
HEADERS = Path(fmpy.__file__).parent / "c-code"
ENVIRONMENT, NAME = "given->componentEnvironment", "joint->name"

FMI2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="talker" guid="talker"
 numberOfEventIndicators="0"><CoSimulation modelIdentifier="talker"
 canHandleVariableCommunicationStepSize="true"/><ModelVariables>
<ScalarVariable name="q" valueReference="0" causality="output" variability="continuous"
 initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="qd" valueReference="1" causality="output" variability="continuous"
 initial="exact"><Real start="0"/></ScalarVariable>
<ScalarVariable name="tau" valueReference="2" causality="input" variability="continuous">
<Real start="0"/></ScalarVariable>
<ScalarVariable name="refuses" valueReference="3" causality="parameter" variability="fixed">
<Real start="0"/></ScalarVariable>
<ScalarVariable name="debug" valueReference="0" causality="parameter" variability="fixed">
<Boolean start="false"/></ScalarVariable>
<ScalarVariable name="level" valueReference="2" causality="parameter" variability="fixed">
<Integer start="1"/></ScalarVariable>
</ModelVariables><ModelStructure><Outputs><Unknown index="1"/><Unknown index="2"/></Outputs>
</ModelStructure></fmiModelDescription>
"""
FMI3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="talker" instantiationToken="talker">
<CoSimulation modelIdentifier="talker" canHandleVariableCommunicationStepSize="true"/>
<ModelVariables>
<Float64 name="q" valueReference="0" causality="output" initial="exact" start="0"/>
<Float64 name="qd" valueReference="1" causality="output" initial="exact" start="0"/>
<Float64 name="tau" valueReference="2" causality="input" start="0"/>
<Float64 name="refuses" valueReference="3" causality="parameter" variability="fixed" start="0"/>
<Float64 name="time" valueReference="9" causality="independent" variability="continuous"/>
</ModelVariables><ModelStructure><Output valueReference="0"/><Output valueReference="1"/>
</ModelStructure></fmiModelDescription>
"""


def build_talker(
    path: Path,
    fmi: int = 2,
    environment: str = ENVIRONMENT,
    name: str = NAME,
    start: str = "NAN",
    edit: Callable[[str], str] = str,
    *,
    prints: bool = False,
) -> Path:
    """Compile it and write its archive, whose description may be edited.

    What it tells the logger of itself, and its start, are C expressions.
    """
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    with TemporaryDirectory() as work, ZipFile(path, "w") as archive:
        library, stubs = Path(work) / "talker", Path(work) / "stubs.c"
        stubs.write_text(_stubs(fmi))
        defined = [f"-DFMI={fmi}", f"-DENVIRONMENT={environment}", f"-DNAME={name}"]
        defined += [f"-DSTART={start}", f"-DPRINTS={int(prints)}"]
        flags = ["-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{HEADERS}"]
        sources = [str(SOURCE), str(stubs)]
        subprocess.run(["cc", *flags, *defined, *sources, "-o", str(library)], check=True)
        archive.write(library, f"binaries/{platform}/talker{fmpy.sharedLibraryExtension}")
        archive.writestr("modelDescription.xml", edit(FMI2 if fmi == 2 else FMI3))
    return path


def _stubs(fmi: int) -> str:
    """Define the calls that FMPy looks for and the talker has no use for; each fails."""
    header = (HEADERS / f"fmi{fmi}Functions.h").read_text()
    known = set(re.findall(rf"fmi{fmi}[A-Z]\w+(?=TYPE)", header))
    has = set(re.findall(rf"fmi{fmi}[A-Z]\w+(?=\()", SOURCE.read_text()))
    return "".join(f"int {name}(void) {{ return 3; }}\n" for name in sorted(known - has))
