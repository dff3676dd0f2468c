"""Bundled models, built, unpacked once, and opened with FMPy."""

import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

import fmpy
import pytest

from nrs_cosim.plant_fmu.bundled.builder import build
from tests.plant_fmu.faulty_fmu import built
from tests.plant_fmu.fmpy_instances import Open, Robot


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


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the folder in which all temporary folders of a test lie."""
    folder = tmp_path / "temporary"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder
