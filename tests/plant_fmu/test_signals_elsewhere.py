"""Other engines move an FMU of ours by the same signals to the same place as a plain loop does."""

import importlib.util
import json
import subprocess
import sys

import numpy as np
import pytest

from nrs_cosim.plant_fmu.bundled.builder import build
from tests.elsewhere import signals
from tests.plant_fmu.test_bundled_model_references import INPUTS, KD, KP, MASS, scalars, wanted

NEEDS = {"ecos": "ecospy", "libcosim": "libcosimpy"}
STEP, STEPS = 0.1, 20
STARTS = scalars({"kp": KP * np.eye(2), "kd": KD * np.eye(2), "m": MASS, "d": 0.0}, 2)
CONSTANT = {
    (f"{name}[{i + 1}]" if len(value) > 1 else name): float(entry)
    for name, value in INPUTS.items()
    for i, entry in enumerate(value)
}
STANDS = {**CONSTANT, "reference_time": 1e30}
TABLE = {
    "set once": ({**STARTS, **CONSTANT}, {}, True),
    "set at each step": (STARTS, CONSTANT, True),
    "stands, set at each step": (STARTS, STANDS, False),
}


@pytest.mark.parametrize("case", TABLE)
@pytest.mark.parametrize("engine", signals.ENGINES)
def test_an_engine_comes_to_the_closed_form_however_it_sets_inputs(engine, case):
    if importlib.util.find_spec(NEEDS[engine]) is None:
        pytest.skip(f"{NEEDS[engine]} is not installed")
    starts, given, moves = TABLE[case]
    task = {
        "starts": starts,
        "signals": [given] * STEPS,
        "step": STEP,
        "outputs": ["q[1]", "q[2]"],
    }
    done = subprocess.run(
        [sys.executable, signals.__file__, engine, build("planar_robot", 2)],
        input=json.dumps(task),
        capture_output=True,
        text=True,
        check=True,
    )
    found = json.loads(done.stdout.splitlines()[-1])
    np.testing.assert_allclose(found, wanted(moves), atol=1e-8, rtol=0)
