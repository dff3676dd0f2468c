"""A stranger's FMU is checked in a process of its own, so that its crash is a finding.

The process writes each finding as a line of JSON once it is made, and null after the last; what
the FMU prints goes to the standard error. It has a deadline, and whatever it started ends with it.
"""

import json
import os
import pickle
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from plant_fmu.checking.findings import Finding, FmuCheck, Task, findings
from plant_fmu.isolation.worker import follow

DEADLINE = 60.0
"""s"""
END = b"null"


def check(task: Task, deadline: float = DEADLINE) -> FmuCheck:
    """Check an FMU of ours in this process, and one of others apart."""
    found = findings(task) if task.archive.ours else _found_apart(task, deadline)
    return FmuCheck(task.archive.label, task.archive.sha256, tuple(found))


def _found_apart(task: Task, deadline: float) -> list[Finding]:
    modules = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
    with TemporaryDirectory(prefix="nrs-") as folder:
        path = Path(folder) / "task"
        path.write_bytes(pickle.dumps(task))
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
    done = lines[-1:] == [END]
    found = [Finding(**json.loads(line)) for line in lines if line != END]
    if not done:
        ending = ending or _ending(process.returncode)
        found.append(_ended(ending, found, printed.decode(errors="replace")))
    return found


def _ended(ending: str, found: list[Finding], printed: str) -> Finding:
    """Return what is found of a process that did not get to its end."""
    after = f" after {found[-1].topic}: {found[-1].name}" if found else ""
    words = [line.strip() for line in printed.splitlines() if line.strip()][-3:]
    said = f"; it printed: {' / '.join(words)}" if words else ""
    return Finding("runs", "process", "fails", f"the process of the FMU {ending}{after}{said}")


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
    """Find what the pickled task asks for; say each as it is made."""
    np.seterr(all="ignore")
    path, parent = sys.argv[1:]
    follow(int(parent))
    task: Task = pickle.loads(Path(path).read_bytes())
    with os.fdopen(os.dup(1), "w") as lines:
        os.dup2(2, 1)
        for finding in findings(task):
            lines.write(json.dumps(asdict(finding)) + "\n")
            lines.flush()
        lines.write(f"{END.decode()}\n")


if __name__ == "__main__":
    main()
