"""States of the bundled models: restored here or in a fresh process, and reset."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from tests.plant_fmu.fmpy_instances import Open
from tests.plant_fmu.test_bundled_models import SETTINGS, STEPS, each_model, each_version, play


@each_version
@each_model
def test_a_restored_state_continues_with_the_same_bits(robot: Open, model: str, fmi: int) -> None:
    with robot(model, fmi) as r:
        r.initialize(**SETTINGS)
        play(r, 0, 7)
        state = r.fmu.getFMUState()
        first = play(r, 7, STEPS)
        r.fmu.setFMUState(state)
        r.fmu.freeFMUState(state)
        assert np.array_equal(play(r, 7, STEPS), first)


CONTINUE = """
import sys
from pathlib import Path
from tests.plant_fmu.fmpy_instances import Robot
from tests.plant_fmu.test_bundled_models import STEPS, play
robot = Robot("two_link_arm", int(sys.argv[1]), Path(sys.argv[2]), "Slave")
robot.fmu.setFMUState(robot.fmu.deserializeFMUState(sys.stdin.buffer.read()))
sys.stdout.write(play(robot, 7, STEPS).tobytes().hex())
"""


@each_version
def test_a_fresh_process_continues_with_the_same_bits(
    robot: Open, unpacked: Callable[[str, int], Path], fmi: int
) -> None:
    with robot("two_link_arm", fmi) as r:
        r.initialize(**SETTINGS)
        play(r, 0, 7)
        state = r.fmu.getFMUState()
        serialized = r.fmu.serializeFMUState(state)
        r.fmu.freeFMUState(state)
        first = play(r, 7, STEPS)
    command = [sys.executable, "-c", CONTINUE, str(fmi), str(unpacked("two_link_arm", fmi))]
    root = Path(__file__).parents[2]
    done = subprocess.run(
        command, input=bytes(serialized), capture_output=True, cwd=root, check=True
    )
    assert done.stdout.decode() == first.tobytes().hex()


@each_version
def test_a_reset_restores_the_start_values(robot: Open, fmi: int) -> None:
    with robot("two_link_arm", fmi) as r:
        r.initialize(**SETTINGS)
        first = play(r, 0, STEPS)
        r.fmu.terminate()
        r.fmu.reset()
        assert r.get("kp").tolist() == [[0.0, 0.0], [0.0, 0.0]]
        r.initialize(**SETTINGS)
        assert np.array_equal(play(r, 0, STEPS), first)


@each_version
def test_importers_that_add_up_time_come_to_the_bits_of_those_that_count_it(
    robot: Open, fmi: int
) -> None:
    ended, added = [], 0.0
    for counts in (True, False):
        with robot("two_link_arm", fmi) as arm:
            arm.initialize(q=[1.0, -1.0], disturbance_rate=[3.0, 1.0])
            added = 0.0
            for k in range(200):
                step = (k + 1) / 10 - k / 10 if counts else 0.1
                arm.fmu.doStep(k / 10 if counts else added, step)
                added += 0.1
            ended.append(np.concatenate([arm.get("q"), arm.get("qd")]))
    assert added != 20.0
    assert np.array_equal(*ended)


def test_times_that_are_no_whole_ns_stay_as_they_are_but_for_rounding(robot: Open) -> None:
    with robot("planar_robot", 2) as arm:
        arm.initialize()
        time = 0.0
        for _ in range(30):
            arm.fmu.doStep(time, 1 / 3)
            time += 1 / 3
            assert abs(arm.get("time") - time) <= 8 * np.spacing(time)
