"""A run whose recording would be large is warned of before it begins."""

import pytest

from nrs_cosim.orchestrator.engine.recording_size import large_recording, planned_messages
from tests.command import nrs
from tests.scenarios import PAPER_FILE, paper

LONG = 10_000_000


def test_messages_are_counted_as_a_run_records_them():
    """Six robots and the target at 300 sampling times; states at t_0 and 1,500 output times."""
    assert planned_messages(paper({})) == 7 * 300 + 6 * 1501
    assert large_recording(paper({})) == ""


@pytest.mark.parametrize("command", [("check",), ("design", "--fastest")], ids=" ".join)
def test_a_large_recording_is_warned_of_with_ticks_messages_and_bytes(command):
    done = nrs(*command, PAPER_FILE, "--set", f"run.duration={LONG / 10}")
    messages = LONG * 7 + 6 * (5 * LONG + 1)
    assert (
        f"warning: a run has {LONG:,} ticks and {messages:,} messages: a recording of about 15 GB"
        in " ".join(done.stderr.split())
    )
