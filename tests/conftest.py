"""Tests that take long are marked `slow`, and `make test-fast` leaves them out; and the snapshots.

`slow.txt` names them, or whole files, as `pytest --durations=0` measured them: those of which a
case takes about half a second, or all cases together more than one.
"""

import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.cases import ALL
from tests.printed import SNAPSHOTS

# What starts the tests may ignore signals, as a shell does for what it puts into the background;
# the processes that tests start are to take them as a user's do.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)

os.environ["NRS_PROGRESS"] = "off"  # what a command prints is of no machine's speed
# Matrices here are small, and BLAS's threads wait for each other by turning round: a fifth of the
# processor time of tests of the theory. xdist's processes inherit it before they load NumPy.
if not ALL:
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

SLOW = frozenset(Path(__file__).with_name("slow.txt").read_text("utf-8").split())


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add the option that writes the snapshots anew."""
    parser.addoption("--snapshots", action="store_true", help="write tests/snapshots anew")


def pytest_xdist_auto_num_workers() -> int:
    """Return one process more than there are processors: tests wait for those they started."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that are slow."""
    for item in items:
        if {item.nodeid.partition("[")[0], item.nodeid.partition("::")[0]} & SLOW:
            item.add_marker(pytest.mark.slow)


@pytest.fixture
def snapshot(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """Return a function that compares a text with the snapshot of a name."""

    def compare(name: str, text: str) -> None:
        path = SNAPSHOTS / f"{name}.txt"
        if request.config.getoption("--snapshots"):
            path.write_text(text, "utf-8")
        assert text == path.read_text("utf-8"), f"tests/snapshots/{path.name}: see make snapshots"

    return compare
