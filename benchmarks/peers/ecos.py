"""ecos through ecospy: a native loop, of which Python asks every value by its name."""

import sys
from ctypes import CDLL, RTLD_GLOBAL
from pathlib import Path

from benchmarks.peers.work import OUTPUTS, H, States, Work, report, timed

CDLL(str(Path(sys.prefix, "lib", "libtbb.so.12")), RTLD_GLOBAL)  # not found by itself

from ecospy import EcosSimulation, EcosSimulationStructure  # noqa: E402 (needs the library above)


def run(work: Work) -> tuple[float, States]:
    """Step all arms in one process, natively connected."""
    structure, parameters = EcosSimulationStructure(), {}
    for arm in range(work.n):
        structure.add_model(f"arm{arm}", work.fmu)
        parameters |= {f"arm{arm}::{name}": value for name, value in work.start_values(arm).items()}
    for (source, given), (sink, taken) in work.links:
        structure.make_real_connection(f"arm{source}::{given}", f"arm{sink}::{taken}")
    structure.add_parameter_set("start", parameters)
    simulation = EcosSimulation(H, structure=structure)
    simulation.init(parameter_set="start")
    names = [[f"arm{arm}::{name}" for name in OUTPUTS] for arm in range(work.n)]

    def step(_k: int) -> States:
        simulation.step()
        return [[simulation.get_real(name) for name in of_arm] for of_arm in names]

    return timed(work, step)


if __name__ == "__main__":
    report(run)
