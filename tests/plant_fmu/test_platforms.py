"""Libraries for other platforms: what they export and import, and what those do that can be run.

lief reads the formats of all three systems. A library for Windows is loaded by Wine where that is
installed, and moves to the very bits of the one for Linux; one for macOS nothing here can load.
"""

import json
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path
from zipfile import ZipFile

import fmpy
import pytest

from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.bundled.compiler import PLATFORMS, ZIG, has_zig
from tests.cases import cases

READ = """
import json, sys, lief
binary = lief.parse(sys.argv[1])
OWN = lief.MachO.LoadCommand.TYPE.ID_DYLIB
of_mach = isinstance(binary, lief.MachO.Binary)
print(json.dumps({
    "exported": [symbol.name for symbol in binary.exported_functions],
    "needed": [getattr(other, "name", other) for other in binary.libraries
               if not (of_mach and other.command == OWN)],
    "signed": of_mach and binary.has_code_signature,
}))
"""
"""Apart from the tests, for lief tells at its end whatever it has not let go."""

pytestmark = pytest.mark.skipif(not has_zig(), reason="needs ziglang (the extra `compiler`)")

HEADERS = Path(fmpy.__file__).parent / "c-code"
SYSTEM = {
    "linux": r"lib[cm]\.so\.6",
    "windows": r"KERNEL32\.dll|api-ms-win-crt-\w+-l1-1-0\.dll",  # Windows 10 has these
    "darwin": r"/usr/lib/libSystem\.B\.dylib",
}
"""Libraries that each system has of its own."""
OF_FORMAT = {"mh_dylib_header", "dso_handle"}
"""What every library of macOS exports beside."""
WINE = shutil.which("wine64") or shutil.which("wine") or shutil.which("/usr/lib/wine/wine64")
# zig compiles Windows' C library first, which takes minutes on a machine where it never has.
BUILT = cases([(fmi, p) for p in PLATFORMS for fmi in (2, 3)], [(3, "darwin64")])


def library(fmi: int, platform: str) -> bytes:
    with ZipFile(build("two_link_arm", fmi, [platform])) as archive:
        return archive.read(
            f"binaries/{PLATFORMS[platform].folder(fmi)}/two_link_arm{PLATFORMS[platform].suffix}"
        )


def functions(fmi: int) -> set[str]:
    """Return what a library of FMI has to export, as the standard's header has it."""
    header = (HEADERS / f"fmi{fmi}Functions.h").read_text()
    return set(re.findall(rf"fmi{fmi}[A-Z]\w+(?=TYPE)", header))


@pytest.mark.skipif(find_spec("lief") is None, reason="needs lief")
@pytest.mark.parametrize(
    ("fmi", "platform"), [(fmi, p) for fmi, p in BUILT if fmi == 3 or PLATFORMS[p].fmi2]
)
def test_a_library_exports_fmi_alone_and_needs_its_system_alone(fmi, platform, tmp_path):
    path = tmp_path / "library"
    path.write_bytes(library(fmi, platform))
    read = subprocess.run([sys.executable, "-c", READ, path], capture_output=True, check=True)
    binary = json.loads(read.stdout)
    system = PLATFORMS[platform].fmi3.partition("-")[2]
    exported = set(binary["exported"])
    if system == "darwin":
        exported = {name.lstrip("_") for name in exported} - OF_FORMAT
    assert exported == functions(fmi)
    assert binary["needed"]
    assert [name for name in binary["needed"] if not re.fullmatch(SYSTEM[system], name)] == []
    # macOS on ARM loads nothing without a signature.
    assert binary["signed"] or platform != "aarch64-darwin"


@pytest.mark.skipif(WINE is None, reason="needs Wine")
@pytest.mark.skipif(sys.platform != "linux", reason="beside the library for Linux")
@pytest.mark.parametrize("fmi", cases([2, 3], []))
def test_windows_library_moves_to_the_same_bits_as_that_of_linux(fmi, tmp_path):
    said = {}
    for platform, run in (("linux64", []), ("win64", [WINE])):
        name = f"arm{PLATFORMS[platform].suffix}"
        (tmp_path / name).write_bytes(library(fmi, platform))
        program = loader(fmi, platform, tmp_path)
        done = subprocess.run(
            [*run, program, f"./{name}", token(fmi)],
            cwd=tmp_path,
            env={"WINEPREFIX": str(tmp_path / "wine"), "WINEDEBUG": "-all", "HOME": str(tmp_path)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        said[platform] = [float(line) for line in done.stdout.split()]
    assert said["win64"] == said["linux64"]
    assert len(said["win64"]) == 80
    assert abs(said["win64"][-1]) > 1e-3


def token(fmi: int) -> str:
    with ZipFile(build("two_link_arm", fmi)) as archive:
        text = archive.read("modelDescription.xml").decode()
    return re.search(r' (?:guid|instantiationToken)="([^"]*)"', text)[1]


def loader(fmi: int, platform: str, folder: Path) -> Path:
    """Compile what loads the arm, starts it at rest away from its equilibrium, and lets it go."""
    with ZipFile(build("two_link_arm", fmi)) as archive:
        text = archive.read("modelDescription.xml").decode()
    references = re.findall(r'name="(?:q|qd)(?:\[\d\])?" valueReference="(\d+)"', text)
    program = folder / f"load_{platform}.exe"
    each = " ".join(f'DO("{name}")' for name in sorted(functions(fmi)))
    defined = {
        "FMI": str(fmi),
        "EACH(DO)": each,
        "SET": f"{{{', '.join(references)}}}",
        "GET": f"{{{', '.join(references)}}}",
        "VALUES": "{0.7, -0.4, 0.0, 0.0}",
    }
    flags = [f"-D{name}={value}" for name, value in defined.items()]
    source = Path(__file__).with_name("loading.c")
    target = ["-target", PLATFORMS[platform].target]
    command = [*ZIG, *target, *flags, f"-I{HEADERS}", "-O1", str(source), "-o", str(program)]
    subprocess.run([*command, "-ldl"] if platform == "linux64" else command, check=True)
    return program
