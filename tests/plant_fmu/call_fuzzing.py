"""Random sequences of FMI calls on the bundled models, under the compiler's sanitizers.

`python -m tests.plant_fmu.call_fuzzing [SEQUENCES]` tries so many of each model and version.
"""

import os
import shlex
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZipFile

from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models

SOURCE = Path(__file__).with_suffix(".c")
FLAGS = (
    *("-std=gnu11", "-O1", "-g", "-ffp-contract=off"),
    *("-fsanitize=address,undefined,float-cast-overflow", "-fno-sanitize-recover=all"),
)
FAULTS = ("leak", "overflow", "undefined")
"""What it commits when it is asked to, and the sanitizers must find."""


def has_sanitizers(folder: Path) -> bool:
    """Whether the compiler makes programs with them, and this machine runs these."""
    (folder / "none.c").write_text("int main(void) { return 0; }\n")
    compiled = _compile(folder, ["none.c"], folder / "none")
    return compiled and subprocess.run([folder / "none"], check=False).returncode == 0


def compile_fuzzer(model: str, fmi: int, folder: Path) -> Path:
    """Compile the sources of a model's FMU into a program that makes calls."""
    with ZipFile(build(model, fmi)) as archive:
        archive.extractall(folder)
    sources = folder / "sources"
    units = [str(SOURCE), *(path.name for path in sources.glob("*.c"))]
    program = folder / "fuzzer"
    assert _compile(sources, [f"-DFMI_VERSION={fmi}", "-I.", *units, "-lm"], program)
    return program


def fuzz(program: Path, first: int, sequences: int, *fault: str) -> tuple[int, str]:
    """Return the exit status of so many sequences from a first seed on, and what is printed."""
    command = [program, str(first), str(sequences), *fault]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout + done.stderr


def _compile(folder: Path, arguments: list[str], program: Path) -> bool:
    compiler = shlex.split(os.environ.get("CC", "cc"))
    command = [*compiler, *FLAGS, *arguments, "-o", str(program)]
    return subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode == 0


def main() -> int:
    """Fuzz all models, and say what was tried."""
    sequences = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    failed = False
    for model in bundled_models():
        for fmi in (2, 3):
            with TemporaryDirectory() as folder:
                program = compile_fuzzer(model, fmi, Path(folder))
                if any(fuzz(program, 1, 1, fault)[0] == 0 for fault in FAULTS):
                    print("the sanitizers do not find what they should")
                    return 1
                status, text = fuzz(program, 1, sequences)
            tried = text.split()
            said = f"{tried[1]} calls, {tried[2]} errors, as it should be" if not status else text
            print(f"{model}, FMI {fmi}: {sequences} sequences, {said}", flush=True)
            failed |= status != 0
    return int(failed)


if __name__ == "__main__":
    sys.exit(main())
