"""A stranger's FMU is looked at in a process of its own, so that its crash is a finding.

The process writes what it is to say as lines of JSON, each once it is known, and null after the
last; what it is at stands between them, as signs of life. What the FMU prints goes to the standard
error. A call of the FMU has a deadline, and whatever the process started ends with it.
"""

import json
import os
import pickle
import selectors
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.bundled.bounds import Bounds
from nrs_cosim.plant_fmu.checking.budget import LIMIT, STARTING, VALIDATING, Budget, Tell, unheard
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding, FmuCheck
from nrs_cosim.plant_fmu.checking.procedure import findings
from nrs_cosim.plant_fmu.checking.sampling import sampled
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.isolation.worker import follow

DEADLINE = 60.0
"""s"""
END = b"null"

PRINTED = 1 << 14
"""Bytes of what the FMU printed that are looked at, the last ones."""
OURS = ("", STARTING, VALIDATING)
"""The stages in which no FMU is called."""
P3_LIMIT = 60.0
"""s of processor time."""

Say = Callable[[CheckTask, Tell], Iterator[dict[str, Any]]]
"""What a process is to say of a task, for JSON; a function of a module. It tells each stage."""


@dataclass(frozen=True, slots=True)
class ProcessOutcome:
    """What a process told before it ended, and how that was; nothing where it got to its end."""

    lines: list[dict[str, Any]]
    ending: str
    printed: str
    """The last words of what the FMU printed, as the end of a sentence."""
    stage: str = ""
    """The last that began."""


def check(task: CheckTask, deadline: float = DEADLINE, tell: Tell = unheard) -> FmuCheck:
    """Check an FMU of ours in this process, and one of others apart; tell each stage."""
    if task.archive.ours:
        found = list(findings(task, Budget(tell)))
    else:
        found = _found_apart(task, deadline, tell)
    return FmuCheck(task.archive.label, task.archive.sha256, tuple(found))


def p3_of(task: CheckTask, deadline: float = DEADLINE) -> Bounds:
    """Return P3 of a robot by sampling: of an FMU of ours in this process, else apart.

    `FmuError` says why there is none.
    """
    if task.archive.ours:
        return sampled(task, Budget(limit=P3_LIMIT))
    report = run_apart(_say_p3, task, deadline)
    if report.ending:
        raise FmuError(f"the process of the FMU {report.ending}{report.printed}")
    (line,) = report.lines
    if "why" in line:
        raise FmuError(line["why"])
    return Bounds(**line)


def _found_apart(task: CheckTask, deadline: float, tell: Tell) -> list[Finding]:
    report = run_apart(say_findings, task, deadline, tell)
    found = [Finding(**line) for line in report.lines]
    if report.ending:
        after = f", after {found[-1].topic}: {found[-1].name}" if found else ""
        text = f"the process of the FMU {report.ending} while {report.stage}{after}{report.printed}"
        found.append(Finding("runs", "process", "fails", text))
    return found


def say_findings(task: CheckTask, tell: Tell, limit: float = LIMIT) -> Iterator[dict[str, Any]]:
    """Yield all findings for JSON, each stage of which may take so long."""
    return map(asdict, findings(task, Budget(tell, tell, limit)))


def _say_p3(task: CheckTask, tell: Tell) -> Iterator[dict[str, Any]]:
    try:
        yield asdict(sampled(task, Budget(tell, tell, P3_LIMIT)))
    except (CosimError, np.linalg.LinAlgError) as error:
        yield {"why": str(error)}


def run_apart(say: Say, task: CheckTask, deadline: float, tell: Tell = unheard) -> ProcessOutcome:
    """Run a function on a task in a process of its own.

    The process may be silent for a deadline in s, as long as a call of the FMU may take; while it
    starts and while no FMU is called it has `DEADLINE` at least.
    """
    modules = os.pathsep.join(str(Path(entry).absolute()) for entry in sys.path)
    with TemporaryDirectory(prefix="nrs-") as folder, TemporaryFile() as printed:
        path = Path(folder) / "task"
        path.write_bytes(pickle.dumps((say, task)))
        process = subprocess.Popen(
            [
                sys.executable,
                "-P",
                "-m",
                "nrs_cosim.plant_fmu.checking.subprocess_check",
                str(path),
                str(os.getpid()),
            ],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=printed,
            env={**os.environ, "PYTHONPATH": modules, "TMPDIR": folder},
            start_new_session=True,
        )
        try:
            report = _listen(process, deadline, tell)
        finally:
            _kill(process)
        printed.seek(max(0, printed.tell() - PRINTED))
        words = printed.read().decode(errors="replace").splitlines()
    words = [line.strip() for line in words if line.strip()]
    return replace(report, printed=f"; it printed: {' / '.join(words[-3:])}" if words else "")


def _listen(process: subprocess.Popen[bytes], deadline: float, tell: Tell) -> ProcessOutcome:
    """Return what a process says until its end, or until it is silent for too long."""
    assert process.stdout is not None
    lines: list[dict[str, Any]] = []
    stage, unfinished = "", b""
    with selectors.DefaultSelector() as selector, process.stdout as said:
        selector.register(said, selectors.EVENT_READ)
        while True:
            patience = deadline if stage not in OURS else max(deadline, DEADLINE)
            if not selector.select(patience):
                return ProcessOutcome(lines, f"did not return within {patience:g} s", "", stage)
            heard = os.read(said.fileno(), 1 << 16)
            if not heard:
                process.wait()
                return ProcessOutcome(lines, _ending(process.returncode), "", stage)
            *whole, unfinished = (unfinished + heard).split(b"\n")
            for line in whole:
                if line == END:
                    return ProcessOutcome(lines, "", "", stage)
                found = json.loads(line)
                if "now" not in found:
                    lines.append(found)
                elif found["now"] != stage:
                    stage = found["now"]
                    tell(stage)


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
    say, task = pickle.loads(Path(path).read_bytes())
    with os.fdopen(os.dup(1), "w") as lines:
        os.dup2(2, 1)

        def write(line: dict[str, Any]) -> None:
            lines.write(json.dumps(line) + "\n")
            lines.flush()

        for line in say(task, lambda stage: write({"now": stage})):
            write(line)
        lines.write(f"{END.decode()}\n")


if __name__ == "__main__":
    main()
