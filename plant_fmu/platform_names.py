"""What FMI calls the platform of this machine, as FMPy has it, which takes longer to load."""

import platform
import sys

_SYSTEM = {"win32": "windows", "cygwin": "windows", "darwin": "darwin"}.get(sys.platform, "linux")
_IS_ARM = platform.machine().lower() in {"aarch64", "arm64"}

FMI3 = f"{'aarch64' if _IS_ARM else 'x86_64'}-{_SYSTEM}"
FMI2 = f"{'win' if _SYSTEM == 'windows' else _SYSTEM}64"
LIBRARY = {"windows": ".dll", "darwin": ".dylib"}.get(_SYSTEM, ".so")
"""How the name of a shared library ends."""
