"""Robots of other people's URDFs, built and compared with Pinocchio; a table of them in Markdown.

python -m tests.urdfs FOLDER [--only WORD]

FOLDER holds wheels from PyPI, which pip has downloaded (see the Makefile).
"""

import argparse
import os
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pinocchio

from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_couplings import Couplings, couplings
from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY, build_urdf
from nrs_cosim.plant_fmu.bundled.urdf_robot import UrdfRobot
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.plant_fmu.equations import Equations
from tests.plant_fmu.pinocchio_reference import Reference

STATES, INTERVALS, STEP = 5, 20, 0.05
TOLERANCE = 1e-12
"""Of accelerations, relative to the largest."""
LEAST = 0.9
"""The part of robots with inertias that are built."""
NO_ROBOT, NO_INERTIA = "has no moving joint", ("all that moves with it included", "no <inertia>")
TITLE = """\
# Robots of other people's URDFs

`make urdfs` downloads packages of URDFs from PyPI, builds each robot, and has written this page.
The *error* is that of accelerations of the compiled FMU at five random states beside Pinocchio's,
relative to the largest. Then the robot is held where it starts, over intervals of 0.05 s, by gains
of kp = 100 M_jj and kd = 20 M_jj for joint j: what an *interval* takes, and the fastest rate of kd
and damping over M, which is what makes a robot stiff. Times are processor time; what has the same
equations as a file above is in the cache, and built in no time.
"""
HEAD = "| robot | package | joints | built, s | error | interval, ms | kd over inertia, 1/s |"


@dataclass(frozen=True)
class Found:
    """What came of a file: one cell of the table each, or why it was refused."""

    cells: tuple[str, ...] = ()
    error: float = 0.0
    refused: str = ""


def files(folder: Path, into: Path) -> Iterator[tuple[str, str, Path]]:
    """Yield the name, the package and the path of each URDF that is in a wheel."""
    for wheel in sorted(folder.glob("*.whl")):
        package = wheel.name.split("-")[0].replace("_", "-")
        with ZipFile(wheel) as archive:
            members = [Path(name) for name in archive.namelist() if name.endswith(".urdf")]
            stems = Counter(member.stem for member in members)
            for member in sorted(members):
                folder_of = next(p.name for p in member.parents if p.name not in {"urdf", "robots"})
                name = member.stem if stems[member.stem] == 1 else folder_of
                yield name, package, Path(archive.extract(str(member), into / package))


def main() -> int:
    """Print the table; 1 where too few robots are built, or one moves otherwise than it should."""
    parser = argparse.ArgumentParser(prog="python -m tests.urdfs", description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", default="")
    asked = parser.parse_args()
    print(TITLE)
    print(HEAD, "---".join("|" * (HEAD.count("|"))), sep="\n")
    outcomes, refused, worst = Counter[str](), [], 0.0
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NRS_CACHE"] = f"{folder}/cache"  # for all of them to be compiled
        for number, (name, package, path) in enumerate(files(asked.folder, Path(folder))):
            if asked.only not in f"{package}/{name}":
                continue
            found = look_at(path, Path(folder) / str(number))
            outcomes[found.refused and outcome(found.refused)] += 1
            if not found.refused:
                worst = max(worst, found.error)
                print(f"| {name} | {package} | {' | '.join(found.cells)} |", flush=True)
            elif outcome(found.refused) != NO_ROBOT:
                refused.append(f"- {name} ({package}): {found.refused}")
    built, wrong = outcomes[""], outcomes["other"]
    print(f"\n{built} of {built + wrong} robots with inertias are built, and the largest error is")
    print(f"{worst:.1e}. Of the other files {outcomes[NO_ROBOT]} have no moving joint, and")
    print(f"{outcomes['no inertia']} have joints that move nothing with a mass. Refused are:\n")
    print(*refused, sep="\n")
    return int(built < LEAST * (built + wrong) or worst > TOLERANCE)


def outcome(refused: str) -> str:
    """Return what kind of a refusal it is."""
    if NO_ROBOT in refused:
        return NO_ROBOT
    lacking = all(any(w in line for w in NO_INERTIA) for line in refused.split("; "))
    return "no inertia" if lacking else "other"


def look_at(path: Path, folder: Path) -> Found:
    """Build a robot, and compare and step it."""
    try:
        robot = read_urdf(path)
    except FmuError as error:
        lines = [line.removeprefix(f"{path}: ") for line in str(error).splitlines()]
        return Found(refused="; ".join(line.partition(";")[0] for line in lines))
    before = processor_time()
    fmu = build_urdf(robot)
    built = processor_time() - before
    coupled, m = couplings(robot.joints), len(robot.axes)
    names = [joint.name for joint in coupled.moving]
    damping = np.array([joint.damping for joint in coupled.moving])
    reference = Reference(pinocchio.buildModelFromUrdf(str(path)), names, GRAVITY, damping)
    error = _error(Equations(fmu, folder), reference, coupled)
    mass = _mass(reference, coupled, np.zeros(m))
    gain = 20 * np.diag(np.diag(mass))
    drag = coupled.G.T @ np.diag(damping) @ coupled.G
    rate = np.abs(np.linalg.eigvals(np.linalg.solve(mass, gain + drag))).max()
    spent = _interval(robot, fmu, gain)
    cells = (f"{m}", f"{built:.1f}", f"{error:.0e}", f"{1e3 * spent:.2f}", f"{rate:.3g}")
    return Found(cells, error)


def processor_time() -> float:
    """Processor time of this process and those that it has waited for, s."""
    used = (resource.getrusage(of) for of in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    return sum(one.ru_utime + one.ru_stime for one in used)


def _mass(reference: Reference, coupled: Couplings, q: np.ndarray) -> np.ndarray:
    mass: np.ndarray = coupled.G.T @ reference.mass(coupled.G @ q + coupled.offset) @ coupled.G
    return mass


def _error(fmu: Equations, reference: Reference, coupled: Couplings) -> float:
    random, worst, m = np.random.default_rng(18), 0.0, coupled.G.shape[1]
    for _ in range(STATES):
        q, qd, force = (random.uniform(-size, size, m) for size in (3, 2, 20))
        wanted = reference.coupled(coupled.G, coupled.offset, q, qd, force)
        error = np.abs(fmu.acceleration(q, qd, force) - wanted).max() / np.abs(wanted).max()
        worst = max(worst, float(error))
    fmu.fmu.freeInstance()
    return worst


def _interval(robot: UrdfRobot, fmu: Path, gain: np.ndarray) -> float:
    """Return the processor time of an interval, s; nan where it cannot be stepped."""
    none = np.zeros(len(robot.axes))
    still = Disturbance(none, none, *np.zeros((3, len(none), 0)))
    body = Body(1, {}, 5 * gain, gain, still, none, none, none, none)
    with ExitStack() as stack:
        try:
            plants = open_plants(stack, open_archive(fmu), [body], {})
            plants.advance(0.0, STEP)
            before = processor_time()
            for k in range(1, INTERVALS + 1):
                plants.advance(k * STEP, STEP)
        except (FmuError, StepError):
            return float("nan")
        return (processor_time() - before) / INTERVALS


if __name__ == "__main__":
    sys.exit(main())
