"""An FMI 3 FMU with variables of many types: it stores what it is told, and gives it as Float64.

Its arrays have the length of a structural parameter, and it refuses values of another number, so
that what reaches it is just what was meant. A step makes x what u is.
"""

import re
import subprocess
from pathlib import Path
from zipfile import ZipFile

import fmpy

VENDOR = Path(fmpy.__file__).parent / "c-code"
TYPES = ["Float32", "Float64", "Boolean"]
TYPES += [f"{sign}Int{bits}" for sign in ("", "U") for bits in (8, 16, 32, 64)]

VARIABLES = """
<UInt64 name="n" valueReference="0" causality="structuralParameter" start="4"/>
<Float64 name="u" valueReference="1" causality="input" start="1 2 3 4">
  <Dimension valueReference="0"/>
</Float64>
<Float64 name="x" valueReference="2" causality="output" initial="exact" start="0 0 0 0">
  <Dimension valueReference="0"/>
</Float64>
<Float64 name="kp" valueReference="3" causality="parameter" start="0 0 0 0">
  <Dimension start="2"/><Dimension start="2"/>
</Float64>
<Float64 name="kd" valueReference="4" causality="parameter" start="0 0 0 0">
  <Dimension start="2"/><Dimension start="2"/>
</Float64>
<Float64 name="tau_applied" valueReference="5" causality="output"><Dimension start="2"/></Float64>
<Boolean name="brake" valueReference="6" causality="parameter" start="false"/>
<Int32 name="gear" valueReference="7" causality="parameter" start="1"/>
<Enumeration name="mode" valueReference="8" declaredType="Mode" causality="parameter" start="1"/>
<String name="table" valueReference="9" causality="parameter"><Start value="a"/></String>
<Float32 name="ratios" valueReference="10" causality="parameter" start="0 0 0 0">
  <Dimension valueReference="0"/>
</Float32>
<UInt8 name="pins" valueReference="11" causality="parameter" start="0 0 0 0">
  <Dimension start="2"/><Dimension start="2"/>
</UInt8>
<Float64 name="sum" valueReference="12" causality="calculatedParameter"/>
<Float64 name="energy" valueReference="13" causality="local"/>
<Float64 name="pi" valueReference="14" causality="output" variability="constant" start="3.14"/>
<Float64 name="time" valueReference="15" causality="independent"/>
<Binary name="blob" valueReference="16" causality="parameter"><Start value="00"/></Binary>
"""

DESCRIPTION = f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0" modelName="typed" instantiationToken="typed">
<CoSimulation modelIdentifier="typed"/>
<TypeDefinitions><EnumerationType name="Mode">
  <Item name="servo" value="1"/><Item name="free" value="4"/>
</EnumerationType></TypeDefinitions>
<ModelVariables>{VARIABLES}</ModelVariables><ModelStructure/>
</fmiModelDescription>
"""

SOURCE = """
#include <stdlib.h>
#include <string.h>
#include "fmi3Functions.h"

typedef struct { int configuring; double values[32][64]; } Box;

static size_t length_of(const Box *box, fmi3ValueReference r)
{
    switch (r) {
    case 1: case 2: case 10: return (size_t)box->values[0][0];
    case 3: case 4: case 11: return 4;
    case 5: return 2;
    default: return 1;
    }
}

static int counts(const Box *box, const fmi3ValueReference r[], size_t n, size_t values)
{
    size_t sum = 0;
    for (size_t i = 0; i < n; i++) sum += length_of(box, r[i]);
    return sum == values;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String a, fmi3String b, fmi3String c, fmi3Boolean d,
    fmi3Boolean e, fmi3Boolean f, fmi3Boolean g, const fmi3ValueReference h[], size_t i,
    fmi3InstanceEnvironment j, fmi3LogMessageCallback k, fmi3IntermediateUpdateCallback l)
{
    Box *box = calloc(1, sizeof *box);
    box->values[0][0] = 4;
    return box;
}
void fmi3FreeInstance(fmi3Instance box) { free(box); }
fmi3Status fmi3EnterConfigurationMode(fmi3Instance box) { ((Box *)box)->configuring = 1; return 0; }
fmi3Status fmi3ExitConfigurationMode(fmi3Instance box) { ((Box *)box)->configuring = 0; return 0; }
fmi3Status fmi3EnterInitializationMode(fmi3Instance a, fmi3Boolean b, fmi3Float64 c, fmi3Float64 d,
    fmi3Boolean e, fmi3Float64 f) { return 0; }
fmi3Status fmi3ExitInitializationMode(fmi3Instance a) { return 0; }
fmi3Status fmi3DoStep(fmi3Instance box, fmi3Float64 a, fmi3Float64 b, fmi3Boolean c,
    fmi3Boolean *d, fmi3Boolean *e, fmi3Boolean *f, fmi3Float64 *g)
{
    memcpy(((Box *)box)->values[2], ((Box *)box)->values[1], sizeof ((Box *)box)->values[1]);
    return 0;
}

#define SET(Type) \\
fmi3Status fmi3Set##Type(fmi3Instance instance, const fmi3ValueReference r[], size_t n, \\
    const fmi3##Type values[], size_t count) \\
{ \\
    Box *box = instance; \\
    if (!counts(box, r, n, count)) return 3; \\
    for (size_t i = 0; i < n; i++) { \\
        if ((r[i] == 0) != box->configuring) return 3; \\
        for (size_t j = 0, m = length_of(box, r[i]); j < m; j++) \\
            box->values[r[i]][j] = (double)*values++; \\
    } \\
    return 0; \\
}
"""

READING = """
fmi3Status fmi3SetString(fmi3Instance box, const fmi3ValueReference r[], size_t n,
    const fmi3String values[], size_t count)
{
    for (size_t i = 0; i < strlen(values[0]); i++) ((Box *)box)->values[r[0]][0] += values[0][i];
    return 0;
}
fmi3Status fmi3GetFloat64(fmi3Instance box, const fmi3ValueReference r[], size_t n,
    fmi3Float64 values[], size_t count)
{
    if (!counts(box, r, n, count)) return 3;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < length_of(box, r[i]); j++) *values++ = ((Box *)box)->values[r[i]][j];
    return 0;
}
"""


def build_typed(folder: Path) -> Path:
    """Compile the FMU into a folder; the functions of FMI 3 that it does not use are errors."""
    source = SOURCE + "".join(f"SET({kind})\n" for kind in TYPES) + READING
    header = (VENDOR / "fmi3Functions.h").read_text()
    names = set(re.findall(r"TYPE\s+(fmi3\w+);", header)) - set(
        re.findall(r"\b(fmi3\w+)\(", source)
    )
    stubs = "".join(f"int {name}(void) {{ return 3; }}\n" for name in sorted(names - _sets()))
    (folder / "typed.c").write_text(source)
    (folder / "stubs.c").write_text(stubs)
    library = folder / f"typed{fmpy.sharedLibraryExtension}"
    command = ["cc", "-shared", "-fPIC", f"-I{VENDOR}", "typed.c", "stubs.c", "-o", str(library)]
    subprocess.run(command, cwd=folder, check=True)
    with ZipFile(folder / "typed.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", DESCRIPTION)
        archive.write(library, f"binaries/{fmpy.platform_tuple}/{library.name}")
    return folder / "typed.fmu"


def _sets() -> set[str]:
    return {f"fmi3Set{kind}" for kind in TYPES}
