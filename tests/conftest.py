"""Tests that take long are marked `slow`, and `make test-fast` leaves them out.

`slow.txt` names them, or whole files, as `pytest --durations=0` measured them: those of which a
case takes about half a second, or all cases together two.
"""

from pathlib import Path

import pytest

SLOW = frozenset(Path(__file__).with_name("slow.txt").read_text("utf-8").split())


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark the tests that are slow."""
    for item in items:
        if {item.nodeid.partition("[")[0], item.nodeid.partition("::")[0]} & SLOW:
            item.add_marker(pytest.mark.slow)
