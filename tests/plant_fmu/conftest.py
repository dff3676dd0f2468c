"""Bundled models, built, unpacked once, and opened with FMPy; and an FMU that fails on request."""

import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import pytest

from nrs_cosim.plant_fmu.bundled import builder, declaration
from nrs_cosim.plant_fmu.bundled.builder import build
from tests.plant_fmu.robots import Open, Robot

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


@pytest.fixture(scope="session")
def faulty(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return built(tmp_path_factory.mktemp("faulty"))


@pytest.fixture(scope="session")
def unpacked() -> Iterator[Callable[[str, int], Path]]:
    with TemporaryDirectory() as folder:

        def path(model: str, fmi: int) -> Path:
            target = Path(folder) / f"{model}{fmi}"
            if not target.exists():
                fmpy.extract(build(model, fmi), unzipdir=target)
            return target

        yield path


@pytest.fixture
def robot(unpacked: Callable[[str, int], Path]) -> Open:
    @contextmanager
    def opened(model: str, fmi: int, kind: str = "Slave") -> Iterator[Robot]:
        robot = Robot(model, fmi, unpacked(model, fmi), kind)
        try:
            yield robot
        finally:
            robot.fmu.freeInstance()

    return opened
