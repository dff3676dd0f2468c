"""Says in a sentence what came of a run, and how to look at it.

python -m docs.demo FILE.mcap
"""

import sys
from pathlib import Path

import nrs_cosim as nrs

_WORDS = {
    "within": "within what is proven of them",
    "transient": "above what is proven of the steady state, for the initial error is still there",
    "exceeded": "BEYOND what is proven of them",
}


def sentence(recording: nrs.Recording) -> str:
    """Return a run's end and how its errors stand to the theory, in a sentence."""
    names = iter(("estimates of position", "of velocity", "tracking of position", "of velocity"))
    by_status: dict[str, list[str]] = {}
    for row in recording.analysis()["theory"]["quantities"]:
        by_status.setdefault(row["status"], []).append(next(names))
    facts = [
        f"the largest errors ({', '.join(which)}) are "
        f"{_WORDS.get(status, f'{status}: nothing is proven of them')}"
        for status, which in by_status.items()
    ]
    return f"{recording.robots} robots, the run {recording.status}: {'; '.join(facts)}."


if __name__ == "__main__":
    path = Path(sys.argv[1])
    page = path.with_suffix(".html")
    with nrs.Recording(path) as recording:
        print(sentence(recording))
    command = Path(sys.prefix, "bin", "nrs")
    if command.is_relative_to(Path.cwd()):
        command = command.relative_to(Path.cwd())
    print("To see it:")
    print(f"  {command} report {path} -o {page}    then open that page: the arms as they move")
    print(f"  {command} export {path} -o {path.with_suffix('')}    its tables as CSV")
    print(f"  Foxglove, PlotJuggler, Rerun: open {path}, plot /robot_1/state")
