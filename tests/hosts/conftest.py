"""A run on hosts leaves nothing behind: no process, and no temporary folder."""

import tempfile
from pathlib import Path

import pytest

from tests.hosts.running import Host, commands
from tests.hosts.runs import hosts_of


@pytest.fixture
def nothing_is_left(tmp_path_factory, monkeypatch):
    tmp_path_factory.getbasetemp()  # which stays where it is
    with tempfile.TemporaryDirectory() as folder:  # a socket's path must be short
        monkeypatch.setattr(tempfile, "tempdir", folder)
        monkeypatch.setenv("TMPDIR", folder)
        yield
        assert hosts_of() == {}
        assert [path.name for path in Path(folder).iterdir()] == []


@pytest.fixture(autouse=True)
def _hosts_end():
    yield
    Host.end_all()


@pytest.fixture
def nrs():
    """Return a function that starts the command line, or another program."""
    with commands() as start:
        yield start
