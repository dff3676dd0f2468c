"""A run on workers leaves nothing behind: no process, and no temporary folder."""

import tempfile
from pathlib import Path

import pytest

from tests.cluster.local_workers import workers_of
from tests.cluster.remote_workers import Worker, commands
from tests.network.ports import free_port


@pytest.fixture
def nothing_is_left(tmp_path_factory, monkeypatch):
    tmp_path_factory.getbasetemp()  # which stays where it is
    with tempfile.TemporaryDirectory() as folder:  # a socket's path must be short
        monkeypatch.setattr(tempfile, "tempdir", folder)
        monkeypatch.setenv("TMPDIR", folder)
        yield
        assert workers_of() == {}
        assert [path.name for path in Path(folder).iterdir()] == []


@pytest.fixture(autouse=True)
def _workers_end():
    yield
    Worker.end_all()


@pytest.fixture
def address():
    """Return an address on loopback that nobody listens on."""
    return f"127.0.0.1:{free_port()}"


@pytest.fixture
def meet(address):
    """Return that as an endpoint of plain TCP."""
    return f"tcp/{address}"


@pytest.fixture
def nrs():
    """Return a function that starts the command line, or another program."""
    with commands() as start:
        yield start
