"""A mutation is tried in a copy of the tree, so that nothing of it can stay in the tree itself.

The limit of processor time is some times what the tests take without a mutation, so a machine that
is busy kills none; that of wall time is for what waits for ever.
"""

import os
import resource
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from shutil import copyfile
from time import monotonic
from typing import Literal

from tests.mutation.mutations import Mutation

_SLOWER, _LEAST = 4, 10.0
"""How many times as long, and s at least, are allowed."""
_PATIENCE = 60.0
"""s: how long what waits may take beside."""
_LONGEST = 900.0
"""s: how long tests may take without a mutation."""
How = Literal["killed", "timed out", "survived"]


@dataclass(frozen=True, slots=True)
class Usual:
    """What tests take without a mutation, s."""

    processor: float
    wall: float


@dataclass(frozen=True, slots=True)
class Tree:
    """A copy of all files that git knows, as they are now."""

    folder: Path

    @classmethod
    def copied(cls, root: Path, folder: Path) -> "Tree":
        """Copy a tree into an empty folder."""
        listed = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
        done = subprocess.run(listed, cwd=root, check=True, capture_output=True, text=True)
        for name in filter(None, done.stdout.split("\0")):
            if (root / name).is_file() or (root / name).is_symlink():
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                copyfile(root / name, folder / name, follow_symlinks=False)
        return cls(folder)

    def usual(self, tests: list[str]) -> Usual:
        """Return what tests take, with what is built once; exit where they do not pass."""
        before, began = resource.getrusage(resource.RUSAGE_CHILDREN), monotonic()
        status, printed = self._run(tests, _LONGEST, _LONGEST, kept="")
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if status:
            sys.exit(f"{' '.join(tests)}: do not pass without a mutation:\n{printed}")
        spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        return Usual(spent, monotonic() - began)

    def tried(self, mutation: Mutation, tests: list[str], usual: Usual) -> How:
        """Return what became of a mutation."""
        path = self.folder / mutation.module
        source, times = path.read_bytes(), (path.stat().st_atime, path.stat().st_mtime)
        try:
            path.write_bytes(mutation.of(source))
            os.utime(path, (0, 0))  # else what was compiled might be taken for it
            status, _ = self._run(
                tests,
                max(_LEAST, _SLOWER * usual.processor),
                _PATIENCE + _SLOWER * usual.wall,
            )
        finally:
            path.write_bytes(source)
            os.utime(path, times)
        if status is None or status in {-signal.SIGXCPU, -signal.SIGKILL}:
            return "timed out"
        return "killed" if status else "survived"

    def _run(
        self, tests: list[str], processor: float, wall: float, kept: str = "1"
    ) -> tuple[int | None, str]:
        """Run tests up to the first that fails; return their status, None where they do not end."""
        temporary = self.folder / "t"  # a socket's path must be short
        temporary.mkdir(exist_ok=True)
        own = {
            "NRS_CACHE": str(self.folder / "cache"),
            "PYTEST_DEBUG_TEMPROOT": str(temporary),
            "PYTHONDONTWRITEBYTECODE": kept,
            "PYTHONPATH": str(self.folder),
            "TMPDIR": str(temporary),
        }

        def limit() -> None:
            resource.setrlimit(resource.RLIMIT_CPU, (int(processor) + 1, int(processor) + 2))

        process = subprocess.Popen(
            [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests],
            cwd=self.folder,
            env={**os.environ, **own},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            start_new_session=True,
            preexec_fn=limit,  # noqa: PLW1509 (no thread is here)
            text=True,
        )
        try:
            printed, _ = process.communicate(timeout=wall)
        except subprocess.TimeoutExpired:
            return None, ""
        else:
            return process.returncode, printed
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
