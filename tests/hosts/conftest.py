"""Commands that end with their test."""

import pytest

from tests.hosts.running import commands


@pytest.fixture
def nrs():
    """Return a function that starts the command line, or another program."""
    with commands() as start:
        yield start
