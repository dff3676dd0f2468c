"""A stranger's FMU is looked at in a process of its own, so that its crash is a finding.

The process writes what it is to say as lines of JSON, each once it is known, and null after the
last; what it is at stands between them, as signs of life. What the FMU prints goes to the standard
error. A call of the FMU has a deadline, and whatever the process started ends with it.
"""

import json
import os
import pickle
import selectors
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.plant_fmu.bundled.bounds import Bounds
from nrs_cosim.plant_fmu.checking.budget import (
    LIMIT,
    STARTING,
    VALIDATING,
    Budget,
    Tell,
    unobserved,
)
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding, FmuCheck
from nrs_cosim.plant_fmu.checking.procedure import findings
from nrs_cosim.plant_fmu.checking.sampling import sampled
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.processes import (
    describe_ending,
    end_group,
    follow_parent,
    last_words,
    printed_tail,
    start_python,
    wait_group,
)

DEADLINE = 60.0
"""s"""
END = b"null"

OURS = ("", STARTING, VALIDATING)
"""The stages in which no FMU is called."""
P3_LIMIT = 60.0
"""s of processor time."""
BUILT_DEADLINE, BUILT_LIMIT = 30.0, 10.0
"""s: of a call; of processor time, for each stage. A humanoid of 30 joints takes 3 in all."""

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


def check(task: CheckTask, deadline: float = DEADLINE, tell: Tell = unobserved) -> FmuCheck:
    """Check an FMU of ours in this process, and one of others apart; tell each stage."""
    if task.archive.ours:
        found = list(findings(task, Budget(tell)))
    else:
        found = _found_apart(task, deadline, tell)
    return FmuCheck(task.archive.label, task.archive.sha256, tuple(found))


def check_built(task: CheckTask, deadline: float = BUILT_DEADLINE) -> FmuCheck:
    """Check an FMU that was generated here, apart, before anybody gets it.

    Nothing is taken on trust from what generated its equations. What is not found by a deadline in
    s is unknown, not a failure.
    """
    report = run_apart(partial(say_findings, limit=BUILT_LIMIT), task, deadline)
    found = [Finding(**line) for line in report.lines]
    if report.ending.startswith("did not return"):
        text = f"the check was not over after {deadline:g} s"
        found.append(Finding("physics", "mechanics", "unknown", text))
    elif report.ending:
        text = f"the process of the FMU {report.ending}{report.printed}"
        found.append(Finding("runs", "process", "fails", text))
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
    return Bounds(**{**line, "mobility": tuple(line["mobility"])})


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


def run_apart(
    say: Say, task: CheckTask, deadline: float, tell: Tell = unobserved
) -> ProcessOutcome:
    """Run a function on a task in a process of its own.

    The process may be silent for a deadline in s, as long as a call of the FMU may take; while it
    starts and while no FMU is called it has `DEADLINE` at least.
    """
    with TemporaryDirectory(prefix="nrs-") as name:
        folder = Path(name)
        path, printed = folder / "task", folder / "printed"
        path.write_bytes(pickle.dumps((say, task)))
        with printed.open("wb") as stderr:
            process = start_python(
                "nrs_cosim.plant_fmu.checking.subprocess_check",
                str(path),
                stdout=subprocess.PIPE,
                stderr=stderr,
                temporary=folder,
            )
        try:
            report = _listen(process, deadline, tell)
        finally:
            end_group(process)
        return replace(report, printed=last_words(printed_tail(printed)))


def _listen(process: subprocess.Popen[bytes], deadline: float, tell: Tell) -> ProcessOutcome:
    """Return what a process says until its end, or until it is silent for too long."""
    assert process.stdout is not None
    lines: list[dict[str, Any]] = []
    stage, unfinished = "", b""
    with selectors.DefaultSelector() as selector, process.stdout as said:
        selector.register(said, selectors.EVENT_READ)
        while True:
            patience = deadline if stage not in OURS else max(deadline, DEADLINE)
            silence = f"did not return within {patience:g} s"
            if not selector.select(patience):
                return ProcessOutcome(lines, silence, "", stage)
            received = os.read(said.fileno(), 1 << 16)
            if not received:  # it may have something to print, of what it ends with
                status = wait_group(process, patience)
                ended = silence if status is None else describe_ending(status)
                return ProcessOutcome(lines, ended, "", stage)
            *whole, unfinished = (unfinished + received).split(b"\n")
            for line in whole:
                if line == END:
                    return ProcessOutcome(lines, "", "", stage)
                found = json.loads(line)
                if "now" not in found:
                    lines.append(found)
                elif found["now"] != stage:
                    stage = found["now"]
                    tell(stage)


def main() -> None:
    """Tell what the pickled task asks for; say each line as it is known."""
    np.seterr(all="ignore")
    (path,) = sys.argv[1:]
    follow_parent()
    say, task = pickle.loads(Path(path).read_bytes())
    with os.fdopen(os.dup(1), "w") as lines:
        os.dup2(2, 1)

        def write(line: dict[str, Any]) -> None:
            lines.write(json.dumps(line) + "\n")
            lines.flush()

        for line in say(task, lambda stage: write({"now": stage})):
            write(line)
        lines.write(f"{END.decode()}\n")
