"""Robots of other people's URDFs, built and compared with Pinocchio; a table of them in Markdown.

python -m tests.urdfs FOLDER [--only WORD]

FOLDER holds wheels from PyPI, which pip has downloaded (see the Makefile).
"""

import argparse
import os
import resource
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pinocchio

from benchmarks.table import machine, text
from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.archives.families import Spec
from nrs_cosim.plant_fmu.archives.variables import NO_NAMES
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.bundled.urdf import read_urdf
from nrs_cosim.plant_fmu.bundled.urdf_couplings import Couplings, couplings
from nrs_cosim.plant_fmu.bundled.urdf_fmu import GRAVITY, build_urdf
from nrs_cosim.plant_fmu.drives.opening import open_plants
from nrs_cosim.plant_fmu.errors import FmuError, StepError
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.plant_fmu.equations import Equations
from tests.plant_fmu.pinocchio_reference import Reference

STATES, INTERVALS, STEP = 5, 20, 0.05
KP, KD = 200.0, 300.0
"""Of the arm beside which intervals are told, as of the paper's."""
TOLERANCE = 1e-12
"""Of accelerations, relative to the largest."""
LEAST = 0.9
"""The part of robots with inertias that are built."""
NO_ROBOT, NO_INERTIA = "has no moving joint", ("all that moves with it included", "no <inertia>")
BEFORE = Path(__file__).with_name("before.toml")
"""What release 0.1.0 did, and on which machine; see there."""
UNKNOWN = "–"
TITLE = """\
# Robots of other people's URDFs

`make urdfs` downloads packages of URDFs from PyPI, builds each robot, and has written this page,
measured on {machine}.

The *error* is that of accelerations of the compiled FMU at five random states beside Pinocchio's,
relative to the largest. Then the robot is held where it starts, over intervals of {step} s, by
gains of kp = 100 M_jj and kd = 20 M_jj for joint j. What an *interval* takes is told in µs and *in
arms*: of the bundled two-link arm, held by kp = {kp:g} and kd = {kd:g}, which takes turns with the
robot in the same process, so that a busy machine is busy to both. The fastest rate of *kd over
inertia*, of kd and damping over M, is what makes a robot stiff. Times are processor time; what has
the same equations as a file above is in the cache, and built in no time.

{before}
"""
STIFF = """
With one gain for all joints, kp = {kp:g} and kd = {kd:g}, light links are stiff:

{rows}
"""
ONE_KP, ONE_KD = 200.0, 60.0
IIWA = Path(__file__).parent / "plant_fmu" / "robots" / "lbr_iiwa_14.urdf"
"""Beside those of the packages, as a file of our own."""
HEADS = (
    *("robot", "package", "joints", "built, s", "before", "error"),
    *("interval, µs", "before", "in arms", "before", "kd over inertia, 1/s"),
)
STIFF_HEADS = ("robot", "joints", "interval, ms", "before", "in arms")


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
    before = tomllib.loads(BEFORE.read_text("utf-8"))
    about = {
        "before": before["about"].strip(),
        "unknown": UNKNOWN,
        "machine": text(machine()).replace("\n", ", "),
    }
    print(TITLE.format(**about, step=STEP, kp=KP, kd=KD))
    print(*head(HEADS), sep="\n")
    outcomes, refused, worst = Counter[str](), [], 0.0
    light = {IIWA.stem: IIWA}
    with tempfile.TemporaryDirectory() as folder:
        os.environ["NRS_CACHE"] = f"{folder}/cache"  # for all of them to be compiled
        for number, (name, package, path) in enumerate(files(asked.folder, Path(folder))):
            if asked.only not in f"{package}/{name}":
                continue
            if name in before["stiff"]:
                light[name] = path
            found = look_at(path, Path(folder) / str(number))
            outcomes[found.refused and outcome(found.refused)] += 1
            if not found.refused:
                worst = max(worst, found.error)
                was = before["urdfs"].get(name, {})
                m, built, error, interval, arms, rate = found.cells
                was_built, *was_spent = (was.get(k, UNKNOWN) for k in ("built", "interval", "arms"))
                spent = (interval, was_spent[0], arms, was_spent[1])
                print(row((name, package, m, built, was_built, error, *spent, rate)), flush=True)
            elif outcome(found.refused) != NO_ROBOT:
                refused.append(f"- {name} ({package}): {found.refused}")
        stiff = [stiff_row(name, path, before["stiff"]) for name, path in light.items()]
    built, wrong = outcomes[""], outcomes["other"]
    print(STIFF.format(kp=ONE_KP, kd=ONE_KD, rows="\n".join([*head(STIFF_HEADS), *stiff])))
    print(f"{built} of {built + wrong} robots with inertias are built, and the largest error is")
    print(f"{worst:.1e}. Of the other files {outcomes[NO_ROBOT]} have no moving joint, and")
    print(f"{outcomes['no inertia']} have joints that move nothing with a mass. Refused are:\n")
    print(*refused, sep="\n")
    return int(built < LEAST * (built + wrong) or worst > TOLERANCE)


def stiff_row(name: str, path: Path, before: Mapping[str, Mapping[str, float]]) -> str:
    """Return what an interval of a robot takes with one gain for all joints."""
    robot = read_urdf(path)
    one = np.eye(len(robot.axes))
    spent, arm = interval_beside_an_arm(
        build_urdf(robot), _held(len(one), ONE_KP * one, ONE_KD * one)
    )
    was = before[name]["interval"]
    return row((name, len(one), brief(1e3 * spent), f"{was:g}", brief(spent / arm)))


def brief(number: float) -> str:
    """Return a number to two digits."""
    return f"{float(f'{number:.2g}'):g}"


def head(names: Sequence[str]) -> tuple[str, str]:
    """Return the first two rows of a table."""
    return row(names), row(["---"] * len(names))


def row(cells: Iterable[object]) -> str:
    """Return a row of a table."""
    return f"| {' | '.join(map(str, cells))} |"


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
    spent, arm = interval_beside_an_arm(fmu, _held(m, 5 * gain, gain))
    costs = (f"{1e6 * spent:.0f}", brief(spent / arm))
    return Found((f"{m}", f"{built:.1f}", f"{error:.0e}", *costs, brief(rate)), error)


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


def _held(m: int, kp: np.ndarray, kd: np.ndarray) -> Body:
    none = np.zeros(m)
    return Body(1, {}, kp, kd, Disturbance(none, none, *np.zeros((3, m, 0))), *[none] * 4)


def interval_beside_an_arm(
    fmu: Path, body: Body, names: Mapping[str, Spec] = NO_NAMES
) -> tuple[float, float]:
    """Return the processor time of an interval of a robot, and of an arm's in turn with it, s.

    nan where the robot cannot be stepped.
    """
    one, spent = np.eye(2), np.zeros((INTERVALS + 1, 2))
    with ExitStack() as stack:
        try:
            both = [
                open_plants(stack, open_archive(path), [of], called)
                for path, of, called in (
                    (fmu, body, names),
                    (build("two_link_arm"), _held(2, KP * one, KD * one), NO_NAMES),
                )
            ]
            for k, which in np.ndindex(spent.shape):
                before = time.process_time()
                both[which].advance(k * STEP, STEP)
                spent[k, which] = time.process_time() - before
        except (FmuError, StepError):
            return float("nan"), float("nan")
    # The first is not held yet, and warms the caches.
    robot, arm = spent[1:].mean(axis=0)
    return robot, arm


if __name__ == "__main__":
    sys.exit(main())
