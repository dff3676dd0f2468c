"""`stepping.c` as an FMU for Co-Simulation: joints that move by steps of their own."""

import re
import subprocess
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

import fmpy
import numpy as np

SOURCE = Path(__file__).with_name("stepping.c")
HEADERS = Path(fmpy.__file__).parent / "c-code"
INERTIA = np.array([[3.0, 1.0], [1.0, 2.0]])
NAMES = ("q[1]", "q[2]", "qd[1]", "qd[2]", "tau[1]", "tau[2]")


def build_stepping(
    path: Path,
    step: float,
    fmi: int = 2,
    mobility: np.ndarray | None = None,
    damping: float = 0.0,
    rate: float = 1.0,
    *,
    strict: bool = False,
    lasting: bool = False,
    edit: Callable[[str], str] = str,
) -> Path:
    """Compile it and write its archive, whose description may be edited."""
    inverse = np.linalg.inv(INERTIA) if mobility is None else mobility
    rows = ", ".join("{" + ", ".join(map(repr, row)) + "}" for row in inverse.tolist())
    platform = fmpy.platform if fmi == 2 else fmpy.platform_tuple
    with TemporaryDirectory() as work, ZipFile(path, "w") as archive:
        library, stubs = Path(work) / "stepping", Path(work) / "stubs.c"
        stubs.write_text(_stubs(fmi))
        defined = [f"-DFMI={fmi}", f"-DSTEP={step!r}", f"-DMOBILITY={{{rows}}}"]
        defined += [f"-DDAMPING={damping!r}", f"-DSTRICT={int(strict)}"]
        defined += [f"-DRATE={rate!r}", f"-DLASTING={int(lasting)}"]
        flags = ["-shared", "-fPIC", "-O1", "-Wall", "-Wextra", "-Werror", f"-I{HEADERS}"]
        sources = [str(SOURCE), str(stubs)]
        subprocess.run(["cc", *flags, *defined, *sources, "-o", str(library), "-lm"], check=True)
        archive.write(library, f"binaries/{platform}/stepping{fmpy.sharedLibraryExtension}")
        archive.writestr("modelDescription.xml", edit(_fmi2() if fmi == 2 else _fmi3()))
    return path


def _attributes(name: str) -> str:
    if name.startswith("tau"):
        return 'causality="input" variability="continuous"'
    return 'causality="output" variability="continuous" initial="exact"'


def _fmi2() -> str:
    variables = "".join(
        f'<ScalarVariable name="{name}" valueReference="{i}" {_attributes(name)}>'
        '<Real start="0"/></ScalarVariable>'
        for i, name in enumerate(NAMES)
    )
    outputs = "".join(f'<Unknown index="{i}"/>' for i in range(1, 5))
    return (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="2.0" '
        'modelName="stepping" guid="stepping"><CoSimulation modelIdentifier="stepping" '
        'canHandleVariableCommunicationStepSize="true"/>'
        f"<ModelVariables>{variables}</ModelVariables>"
        f"<ModelStructure><Outputs>{outputs}</Outputs></ModelStructure></fmiModelDescription>"
    )


def _fmi3() -> str:
    variables = "".join(
        f'<Float64 name="{name}" valueReference="{i}" {_attributes(name)} start="0"/>'
        for i, name in enumerate(NAMES)
    )
    outputs = "".join(f'<Output valueReference="{i}"/>' for i in range(4))
    return (
        '<?xml version="1.0" encoding="UTF-8"?><fmiModelDescription fmiVersion="3.0" '
        'modelName="stepping" instantiationToken="stepping">'
        '<CoSimulation modelIdentifier="stepping" '
        'canHandleVariableCommunicationStepSize="true"/><ModelVariables>'
        '<Float64 name="time" valueReference="9" causality="independent" '
        f'variability="continuous"/>{variables}</ModelVariables>'
        f"<ModelStructure>{outputs}</ModelStructure></fmiModelDescription>"
    )


def _stubs(fmi: int) -> str:
    """Define the calls that FMPy looks for and the joints have no use for; each fails."""
    header = (HEADERS / f"fmi{fmi}Functions.h").read_text()
    known = set(re.findall(rf"fmi{fmi}[A-Z]\w+(?=TYPE)", header))
    has = set(re.findall(rf"fmi{fmi}[A-Z]\w+(?=\()", SOURCE.read_text()))
    return "".join(f"int {name}(void) {{ return 3; }}\n" for name in sorted(known - has))
