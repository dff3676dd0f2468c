"""C files become a shared library: by this machine's compiler, or for another platform by zig.

Only relative names reach a compiler, and no debug information is asked for, so that the same files
and flags are the same bytes wherever they are compiled. zig, of the extra `compiler`, brings the
headers and libraries of all platforms; it stands in for a compiler of this machine where there is
none.
"""

import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory

from nrs_cosim.plant_fmu.errors import FmuError

ZIG = (sys.executable, "-m", "ziglang", "cc")
PATIENCE = 900.0
"""s: for one library. zig compiles a platform's C library once, which takes some minutes."""


@dataclass(frozen=True, slots=True)
class Platform:
    """Where a library is to run: as FMI 3 and FMI 2 call it, and zig."""

    fmi3: str
    fmi2: str | None
    target: str
    suffix: str

    def folder(self, fmi: int) -> str:
        """What FMI calls it; `FmuError` where FMI 2 does not."""
        name = self.fmi2 if fmi == 2 else self.fmi3
        if name is None:
            raise FmuError(f"{self.fmi3}: is no platform of FMI 2; take FMI 3")
        return name


PLATFORMS = {
    # glibc of 2014, so that the library runs on distributions of that age too
    "linux64": Platform("x86_64-linux", "linux64", "x86_64-linux-gnu.2.17", ".so"),
    "win64": Platform("x86_64-windows", "win64", "x86_64-windows-gnu", ".dll"),
    "darwin64": Platform("x86_64-darwin", "darwin64", "x86_64-macos", ".dylib"),
    "aarch64-linux": Platform("aarch64-linux", None, "aarch64-linux-gnu.2.17", ".so"),
    "aarch64-darwin": Platform("aarch64-darwin", None, "aarch64-macos", ".dylib"),
}
"""By what a user calls them."""


def has_zig() -> bool:
    """Whether the package of zig is installed."""
    return find_spec("ziglang") is not None


def expect_zig() -> None:
    """Raise `FmuError` where zig is not installed."""
    if not has_zig():
        raise FmuError(
            "compiling for chosen platforms needs zig: pip install 'nrs-cosim[compiler]' (100 MB)"
        )


def compiler() -> list[str]:
    """The command of this machine's C compiler, without flags; `FmuError` where there is none."""
    chosen = shlex.split(os.environ.get("CC", ""))
    for command in [chosen] if chosen else [["cc"], ["gcc"], ["clang"]]:
        if shutil.which(command[0]):
            return command
    if not chosen and has_zig():
        return list(ZIG)
    looked_for = f"CC={chosen[0]}" if chosen else "cc, gcc or clang"
    raise FmuError(
        f"no C compiler found (looked for {looked_for}), and bundled models are compiled on "
        "first use. Debian, Ubuntu: sudo apt install gcc libc6-dev. "
        "Fedora: sudo dnf install gcc glibc-devel. macOS: xcode-select --install. "
        "Anywhere: pip install 'nrs-cosim[compiler]'"
    )


def shared_library(
    name: str,
    files: Mapping[str, bytes],
    units: Sequence[str],
    flags: Sequence[str],
    platform: Platform | None = None,
) -> bytes:
    """The library of C files, of which `units` are compiled; `FmuError` has what was complained of.

    It is for this machine unless a platform is given, which zig then compiles for.
    """
    command = compiler() if platform is None else [*ZIG, "-target", platform.target]
    stripped = ["-g0", "-s"] if "ziglang" in command else []  # zig tells the folder else
    with TemporaryDirectory(prefix="nrs-") as folder:
        for file, text in files.items():
            (Path(folder) / file).parent.mkdir(parents=True, exist_ok=True)
            (Path(folder) / file).write_bytes(text)
        try:
            done = subprocess.run(
                [*command, *flags, *stripped, *units, "-o", "library", "-lm"],
                cwd=folder,
                env={**os.environ, "LC_ALL": "C"},
                capture_output=True,
                text=True,
                errors="replace",
                check=False,
                timeout=PATIENCE,
                start_new_session=True,  # a Ctrl-C in the terminal is ours to hear, not its
            )
        except subprocess.TimeoutExpired:
            raise FmuError(f"{name}: {command[0]} did not end within {PATIENCE:g} s") from None
        if done.returncode != 0:
            lines = done.stderr.splitlines()
            errors = [line for line in lines if "error" in line] or lines
            raise FmuError(f"{name}: {command[0]} failed:\n" + "\n".join(errors[:5]))
        return (Path(folder) / "library").read_bytes()
