"""A stranger's FMU is looked at in a process of its own, so that its crash is a finding.

The process writes what it is to tell as lines of JSON, each once it is known, and null after the
last; what the FMU prints goes to the standard error. It has a deadline, and whatever it started
ends with it.
"""

import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bus.errors import CosimError
from plant_fmu.bundled.bounds import Bounds
from plant_fmu.checking.findings import Finding, FmuCheck, Task, findings
from plant_fmu.checking.sampling import sampled
from plant_fmu.errors import FmuError
from plant_fmu.isolation.worker import follow

DEADLINE = 60.0
"""s"""
END = b"null"

Tell = Callable[[Task], Iterator[dict[str, Any]]]
"""What a process is to tell of a task, for JSON; a function of a module."""


@dataclass(frozen=True, slots=True)
class Told:
    """What a process told before it ended, and how that was; nothing where it got to its end."""

    lines: list[dict[str, Any]]
    ending: str
    printed: str
    """The last words of what the FMU printed, as the end of a sentence."""


def check(task: Task, deadline: float = DEADLINE) -> FmuCheck:
    """Check an FMU of ours in this process, and one of others apart."""
    found = findings(task) if task.archive.ours else _found_apart(task, deadline)
    return FmuCheck(task.archive.label, task.archive.sha256, tuple(found))


def p3_of(task: Task, deadline: float = DEADLINE) -> Bounds:
    """Return P3 of a robot by sampling: of an FMU of ours in this process, else apart.

    `FmuError` says why there is none.
    """
    if task.archive.ours:
        return sampled(task)
    told = told_apart(_tell_p3, task, deadline)
    if told.ending:
        raise FmuError(f"the process of the FMU {told.ending}{told.printed}")
    (line,) = told.lines
    if "why" in line:
        raise FmuError(line["why"])
    return Bounds(**line)


def _found_apart(task: Task, deadline: float) -> list[Finding]:
    told = told_apart(_tell_findings, task, deadline)
    found = [Finding(**line) for line in told.lines]
    if told.ending:
        after = f" after {found[-1].topic}: {found[-1].name}" if found else ""
        text = f"the process of the FMU {told.ending}{after}{told.printed}"
        found.append(Finding("runs", "process", "fails", text))
    return found


def _tell_findings(task: Task) -> Iterator[dict[str, Any]]:
    return map(asdict, findings(task))


def _tell_p3(task: Task) -> Iterator[dict[str, Any]]:
    try:
        yield asdict(sampled(task))
    except (CosimError, np.linalg.LinAlgError) as error:
        yield {"why": str(error)}


def told_apart(tell: Tell, task: Task, deadline: float) -> Told:
    """Run a function on a task in a process of its own, for a deadline in s."""
    modules = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
    with TemporaryDirectory(prefix="nrs-") as folder:
        path = Path(folder) / "task"
        path.write_bytes(pickle.dumps((tell, task)))
        process = subprocess.Popen(
            [sys.executable, "-P", "-m", "plant_fmu.checking.apart", str(path), str(os.getpid())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": modules, "TMPDIR": folder},
            start_new_session=True,
        )
        ending = ""
        try:
            told, printed = process.communicate(timeout=deadline)
        except subprocess.TimeoutExpired:
            ending = f"did not return within {deadline:g} s"
            _kill(process)
            told, printed = process.communicate()
        finally:
            _kill(process)
    *lines, _unfinished = told.split(b"\n")
    if lines[-1:] != [END]:
        ending = ending or _ending(process.returncode)
    words = [line.strip() for line in printed.decode(errors="replace").splitlines() if line.strip()]
    said = f"; it printed: {' / '.join(words[-3:])}" if words else ""
    return Told([json.loads(line) for line in lines if line != END], ending, said)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """Kill what is left of the process and of what it started, while its id is its own."""
    if process.returncode is None:
        with suppress(PermissionError, ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def _ending(status: int) -> str:
    if status >= 0:
        return f"exited with status {status}"
    return f"crashed with {signal.Signals(-status).name}"


def main() -> None:
    """Tell what the pickled task asks for; say each line as it is known."""
    np.seterr(all="ignore")
    path, parent = sys.argv[1:]
    follow(int(parent))
    tell, task = pickle.loads(Path(path).read_bytes())
    with os.fdopen(os.dup(1), "w") as lines:
        os.dup2(2, 1)
        for line in tell(task):
            lines.write(json.dumps(line) + "\n")
            lines.flush()
        lines.write(f"{END.decode()}\n")


if __name__ == "__main__":
    main()
