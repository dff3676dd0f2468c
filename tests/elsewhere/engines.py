"""Engines of others run an SSP: what each comes to at the sampling times, beside the answers there.

    python engines.py ENGINE FILE.ssp [TICKS]

It needs the engine and NumPy alone, so that it runs where nothing of ours is, and ends with status
1 where a number is another than the SSP's reference.csv has. An engine is imported where it is run.
"""

import csv
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree import ElementTree
from zipfile import ZipFile

import numpy as np

ANSWERS = "extra/nrs-cosim/reference.csv"
Names = Sequence[tuple[str, str]]
"""Of outputs: a component's name and a variable's."""
Engine = Callable[[Path, Names, float, int, int], Sequence[Sequence[float]]]
"""Runs an SSP by steps in s; returns the outputs after every so many of so many steps."""


def ecos(ssp: Path, names: Names, step: float, steps: int, every: int) -> Sequence[Sequence[float]]:
    """Run it by ecos, which steps by itself and tells each value by name."""
    from ctypes import CDLL, RTLD_GLOBAL  # noqa: PLC0415

    CDLL(str(Path(sys.prefix, "lib", "libtbb.so.12")), RTLD_GLOBAL)  # not found by itself
    from ecospy import EcosSimulation  # noqa: PLC0415

    rows = []
    with EcosSimulation(ssp_path=str(ssp), step_size=step) as simulation:
        simulation.init(parameter_set="initial")
        for done in range(1, steps + 1):
            simulation.step()
            if done % every == 0:
                rows.append([simulation.get_real(f"{of}::{name}") for of, name in names])
        simulation.terminate()
    return rows


def libcosim(
    ssp: Path, names: Names, _step: float, steps: int, every: int
) -> Sequence[Sequence[float]]:
    """Run it by libcosim, whose step is that of the SSP's annotation."""
    from libcosimpy.CosimExecution import CosimExecution  # noqa: PLC0415
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level  # noqa: PLC0415
    from libcosimpy.CosimObserver import CosimObserver  # noqa: PLC0415

    log_output_level(CosimLogLevel.FATAL)
    execution = CosimExecution.from_ssp_file(str(ssp))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    references: dict[str, dict[str, int]] = {}
    for of in dict.fromkeys(of for of, _ in names):
        slave = execution.slave_index_from_instance_name(of)
        variables = execution.slave_variables(slave)
        references[of] = {"": slave, **{v.name.decode(): v.reference for v in variables}}
    rows = []
    for done in range(1, steps + 1):
        if not execution.step():
            raise RuntimeError(f"step {done} failed")
        if done % every == 0:
            row: list[float] = []
            for of, own in references.items():
                wanted = [own[name] for component, name in names if component == of]
                row += observer.last_real_values(own[""], wanted)
            rows.append(row)
    return rows


def fmpy(ssp: Path, names: Names, step: float, steps: int, every: int) -> Sequence[Sequence[float]]:
    """Run it by FMPy, which takes the parameters of all from one file."""
    from fmpy.ssp.simulation import simulate_ssp  # noqa: PLC0415
    from fmpy.ssp.ssd import read_ssv  # noqa: PLC0415

    with TemporaryDirectory() as folder:
        all_of = Path(folder) / "all.ssv"
        all_of.write_bytes(ZipFile(ssp).read("resources/all.ssv"))
        found: Any = simulate_ssp(
            str(ssp),
            step_size=step,
            stop_time=(steps - 0.5) * step,
            parameter_set=read_ssv(str(all_of)),
        )
    return [[row[f"{of}.{name}"] for of, name in names] for row in found[every - 1 :: every]]


ENGINES: dict[str, Engine] = {"ecos": ecos, "libcosim": libcosim, "fmpy": fmpy}


def compared(engine: str, ssp: Path, ticks: int | None = None) -> tuple[int, int, float]:
    """Return how many numbers there are, how many are the same, and the most they differ."""
    with ZipFile(ssp) as archive:
        answers = list(csv.DictReader(archive.read(ANSWERS).decode().splitlines()))
        root = ElementTree.fromstring(archive.read("SystemStructure.ssd"))
    nodes = [of.get("name") or "" for of in root.iter() if of.tag.endswith("}Component")]
    (step,) = (float(of.get("baseStepSize") or 0) for of in root.iter() if "FixedStep" in of.tag)
    period = _period(ssp, nodes[1])
    ticks = min(ticks or len(answers), max(int(row["k"]) for row in answers))
    rows = [row for row in answers if int(row["k"]) <= ticks]
    columns = [name for name in rows[0] if name not in {"k", "robot"}]
    kept = {int(row["robot"]): [name for name in columns if row[name]] for row in rows}
    names = [
        (nodes[robot], re.sub(r"_(\d+)$", r"[\1]", name))
        for robot, own in sorted(kept.items())
        for name in own
    ]
    wanted: dict[int, list[float]] = {}
    for row in rows:
        wanted.setdefault(int(row["k"]), []).extend(float(row[c]) for c in columns if row[c])
    every = round(period / step)
    found = np.array(ENGINES[engine](ssp, names, step, ticks * every, every))
    right = np.array([wanted[k] for k in sorted(wanted)])
    assert found.shape == right.shape, (found.shape, right.shape)
    return right.size, int((found == right).sum()), float(np.abs(found - right).max())


def _period(ssp: Path, node: str) -> float:
    with ZipFile(ssp) as archive:
        text = archive.read(f"resources/{node}.ssv").decode()
    (found,) = re.findall(r'name="sampling_period">\s*<ssv:Real value="([^"]+)"', text)
    return float(found)


if __name__ == "__main__":
    size, same, most = compared(sys.argv[1], Path(sys.argv[2]), *map(int, sys.argv[3:]))
    print(f"{sys.argv[1]}: {same} of {size} numbers are the same; they differ by up to {most:.3g}")
    sys.exit(same != size)
