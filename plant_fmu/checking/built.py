"""An FMU that was generated here is checked before anybody gets it.

That it is valid, loads, runs and moves as mechanics does is not taken on trust from what generated
its equations. The check has a deadline, and what it did not find by then is unknown, not a failure.
"""

from collections.abc import Iterator
from typing import Any

from nrs_cosim.plant_fmu.checking.budget import Tell
from nrs_cosim.plant_fmu.checking.findings import CheckTask, Finding, FmuCheck
from nrs_cosim.plant_fmu.checking.subprocess_check import run_apart, say_findings

DEADLINE, LIMIT = 30.0, 10.0
"""s: of a call; of processor time, for each stage. A humanoid of 30 joints takes 3 in all."""


def check_built(task: CheckTask, deadline: float = DEADLINE) -> FmuCheck:
    """Check an FMU in a process of its own, for as long as a deadline in s allows."""
    report = run_apart(_say, task, deadline)
    found = [Finding(**line) for line in report.lines]
    if report.ending.startswith("did not return"):
        text = f"the check was not over after {deadline:g} s"
        found.append(Finding("physics", "mechanics", "unknown", text))
    elif report.ending:
        text = f"the process of the FMU {report.ending}{report.printed}"
        found.append(Finding("runs", "process", "fails", text))
    return FmuCheck(task.archive.label, task.archive.sha256, tuple(found))


def _say(task: CheckTask, tell: Tell) -> Iterator[dict[str, Any]]:
    return say_findings(task, tell, LIMIT)
