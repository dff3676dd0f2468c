"""How much memory processes have, and had at most: `VmRSS`, `VmHWM` of /proc, so this is for Linux.

`ru_maxrss` would do elsewhere, but a process begins it with what the one that started it had.
"""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path


def peak(pid: int | None = None) -> int:
    """Return the most memory that a process has had, bytes; 0 when it is gone."""
    return _read("VmHWM", pid)


def now(pid: int | None = None) -> int:
    """Return the memory that a process has, bytes; 0 when it is gone."""
    return _read("VmRSS", pid)


def workers() -> Iterator[tuple[str, int]]:
    """Yield the name and the number of each worker process that this process has started."""
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = (folder / "stat").read_text("utf-8").rpartition(")")[2].split()[1]
            words = (folder / "cmdline").read_bytes().split(b"\0")
            if int(parent) == os.getpid() and b"--name" in words:
                yield words[words.index(b"--name") + 1].decode(), int(folder.name)


def _read(name: str, pid: int | None) -> int:
    with suppress(OSError):
        for line in Path(f"/proc/{pid or 'self'}/status").read_text("utf-8").splitlines():
            if line.startswith(f"{name}:"):
                return int(line.split()[1]) * 1024
    return 0
