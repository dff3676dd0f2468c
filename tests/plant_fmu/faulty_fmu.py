"""An FMU that fails on request, built from `faulty`, and the tables of three robots with it."""

import shutil
from pathlib import Path

import pytest

from nrs_cosim.plant_fmu.bundled import builder, declaration
from nrs_cosim.plant_fmu.bundled.builder import build
from tests.scenarios import drawn, tables

FAULTY = Path(__file__).with_name("faulty")
FAULTS = (
    *("none", "segfault", "abort", "exit", "hang", "discard", "error", "fatal", "nan"),
    *("end", "early", "no status"),
)
"""As the FMU numbers them."""


def built(folder: Path) -> Path:
    """Build the FMU: the bundled models' sources, with a shim of its own around theirs."""
    models = folder / "models"
    shutil.copytree(declaration.MODELS, models)
    (models / "fmi3.c").rename(models / "healthy.h")
    shutil.copy(FAULTY / "fmi3.c", models)
    shutil.copytree(FAULTY, models / "faulty", ignore=shutil.ignore_patterns("fmi3.c"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NRS_CACHE", str(folder))
        patch.setattr(declaration, "MODELS", models)
        patch.setattr(builder, "MODELS", models)
        return build("faulty")


def fault_of(fault: str, at: float = 0.55) -> dict[str, float]:
    """Return the FMU's parameters for a fault in the step that ends after a time, s."""
    return {"fault": FAULTS.index(fault), "fault_time": at} if fault != "none" else {}


def three_robots(fault: str = "none", at: float = 0.55, fmu: str = "faulty.fmu", **plant) -> dict:
    """Return the tables of three robots in a row, of which the second has a fault."""
    plant = {"fmu": fmu, **plant}
    return tables(
        {
            "run": {"duration": 1.0, "sampling_period": 0.1, "seed": 1},
            "controller": {"kp": 10.0, "kd": 10.0},
            "network": {"adjacency": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "pinning": [1, 0, 0]},
            "target.axes": [{"rate": 2.0}, {"rate": -2.0}],
            "plant": plant,
            "disturbance": None,
            "initial": drawn(-1.0, 1.0),
            "robots": [{"id": 2, "plant": {**plant, "parameters": fault_of(fault, at)}}],
        }
    )
