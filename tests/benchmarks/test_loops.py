"""What stands beside a run in the tables does the same work: it ends in the recorded states."""

from copy import copy

import numpy as np
import pytest

from benchmarks.bare import fmpys, prebound
from benchmarks.command import measured
from benchmarks.measured import recorded
from benchmarks.peers.beside import judged, ours
from benchmarks.peers.fmpy_loop import run as looped
from benchmarks.peers.work import Work
from benchmarks.work import Motion, keep_motion, scenario
from nrs_cosim.plant_fmu.bundled.builder import build

N, TICKS = 4, 7


@pytest.fixture(scope="module")
def motion(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loops")
    recorded(N, TICKS, 1, folder / "run.mcap")
    keep_motion(scenario(N, TICKS), folder / "run.mcap", folder / "motion.npz")
    return Motion(folder / "motion.npz")


@pytest.mark.parametrize("loop", [fmpys, prebound])
def test_a_bare_loop_ends_in_the_recorded_states(motion, loop):
    assert motion.references.shape == (TICKS, N, 4)
    assert loop(motion)["cpu"] > 0
    other = copy(motion)
    other.end = np.nextafter(motion.end, 9)
    with pytest.raises(AssertionError, match="not the states"):
        loop(other)


def test_driven_arms_end_as_in_a_plain_loop(tmp_path):
    work = Work(str(build("two_link_arm", 2)), N, TICKS, chain=False)
    assert ours(work, tmp_path / "run.mcap")["end"] == looped(work)[1]


def test_the_coupling_of_a_chain_is_described():
    work = Work(str(build("two_link_arm", 2)), N, TICKS, chain=True)
    ends = {way: looped(work, way)[1] for way in ("Jacobi", "Jacobi, first late", "Gauss-Seidel")}
    for way, end in ends.items():
        assert judged(work, np.add(end, 5e-10), ends)[0] == way
    assert judged(work, np.add(ends["Jacobi"], 2e-9), ends)[0].startswith("none of the known ways")


def test_the_script_beside_the_command_ends_in_the_recorded_states(tmp_path):
    found = measured(tmp_path, 1)
    assert all(row["cpu"] > 0 for rows in found.values() for row in rows)
