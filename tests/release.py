"""A release is what a stranger installs: each Python given gets the wheel in a clean environment.

`python -m tests.release [PYTHON…]` builds the sdist and a wheel of it into dist/, installs that
wheel with all extras under each interpreter, and uses it away from the tree: the same digest and an
identical replay everywhere, tables, a report, a robot from its URDF. Without names of interpreters
those of `PATH` are tried. Which versions were not, and why, is said. Ends with 1 where one fails,
where digests differ, and where none was tried.
"""

import json
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
from collections.abc import Sequence
from pathlib import Path

from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]
OLDEST, NEWEST = (3, 11), (3, 14)
URDF = (
    '<robot name="pendulum"><link name="base"/><link name="arm"><inertial><mass value="1"/>'
    '<origin xyz="0 0 -0.5"/><inertia ixx="0.1" iyy="0.1" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    '</inertial></link><joint name="swing" type="continuous"><parent link="base"/>'
    '<child link="arm"/><axis xyz="0 1 0"/></joint></robot>'
)


def built(folder: Path) -> tuple[Path, Path]:
    """Write the sdist, and the wheel that is made of it, as an installer would; their paths."""
    (sdist,) = map(
        Path, SdistBuilder(str(ROOT)).build(directory=str(folder), versions=["standard"])
    )
    with tempfile.TemporaryDirectory() as unpacked:
        with tarfile.open(sdist) as archive:
            archive.extractall(unpacked, filter="data")
        tree = next(Path(unpacked).glob("*/pyproject.toml")).parent
        (wheel,) = WheelBuilder(str(tree)).build(directory=str(folder), versions=["standard"])
    return sdist, Path(wheel)


def tried(python: str, wheel: Path, folder: Path) -> str:
    """Install under one interpreter and use it there; the digest of the paper's example."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    environment["NRS_CACHE"] = str(folder / "cache")

    def said(*command: str | Path) -> str:
        done = subprocess.run(
            list(map(str, command)),
            cwd=folder, env=environment, check=False, capture_output=True, text=True,
        )  # fmt: skip
        if done.returncode:
            raise SystemExit(f"{python}: {' '.join(map(str, command))}\n{done.stdout}{done.stderr}")
        return done.stdout

    said(python, "-m", "venv", folder / "venv")
    at = folder / "venv/bin"
    said(at / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
         "--constraint", ROOT / "constraints.txt", f"{wheel}[all]")  # fmt: skip
    said(at / "python", "-m", "pip", "check")
    (folder / "arm.urdf").write_text(URDF, "utf-8")
    said(at / "nrs", "fmu", "from-urdf", "arm.urdf", "-o", "arm.fmu")
    said(at / "nrs", "run", ROOT / "scenarios/paper_first_order.toml", "-o", "run.mcap")
    said(at / "nrs", "replay", "run.mcap", "--verify")
    said(at / "nrs", "export", "run.mcap", "--to", "parquet", "-o", "tables")
    said(at / "nrs", "report", "run.mcap", "-o", "run.html")
    return str(json.loads(said(at / "nrs", "info", "run.mcap", "--json"))["digest"])


def version_of(python: str) -> tuple[int, ...]:
    """Return an interpreter's version; () of what does not start, as a shim of one not chosen."""
    if not shutil.which(python):
        return ()
    done = subprocess.run(
        [python, "-c", "import sys; print(' '.join(map(str, sys.version_info[:3])))"],
        check=False, capture_output=True, text=True,
    )  # fmt: skip
    return tuple(map(int, done.stdout.split())) if done.returncode == 0 else ()


def chosen(given: Sequence[str]) -> tuple[dict[str, str], list[str]]:
    """Return interpreters with their versions, one of each minor version, and what is left out."""
    minors = range(OLDEST[1], NEWEST[1] + 1)
    found: dict[str, str] = {}
    left, seen = [], set[tuple[int, ...]]()
    for python in given or [f"python3.{minor}" for minor in minors]:
        version = version_of(python)
        shown = ".".join(map(str, version))
        if not version:
            left += [f"{python}: skipped, it does not start"] * bool(given)
        elif version < OLDEST:
            left.append(f"{python}: skipped, {shown} is older than 3.{OLDEST[1]}")
        elif version[:2] in seen:
            left.append(f"{python}: skipped, {shown} is one more of the same minor version")
        else:
            found[python] = shown
            seen.add(version[:2])
    where = "among those given" if given else "on PATH; make release PYTHONS=… names others"
    missing = [f"Python 3.{minor}: not tried, none {where}" for minor in minors]
    return found, left + [
        line for m, line in zip(minors, missing, strict=True) if (3, m) not in seen
    ]


def main(arguments: Sequence[str]) -> int:
    """Build, try, and print a row for each interpreter."""
    pythons, left = chosen(arguments)
    sdist, wheel = built(ROOT / "dist")
    print(f"{sdist}\n{wheel}")
    print(*left, sep="\n", flush=True)
    digests = set[str]()
    for python, version in pythons.items():
        with tempfile.TemporaryDirectory() as folder:
            digest = tried(python, wheel, Path(folder))
        digests.add(digest)
        said = "installed with [all], ran, replayed, exported, reported"
        print(f"{python}: Python {version}: {said}: {digest}", flush=True)
    same = "the same digest" if len(digests) == 1 else f"{len(digests)} digests"
    print(f"versions of Python tried: {len(pythons)}; {same}")
    return int(len(digests) != 1)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
