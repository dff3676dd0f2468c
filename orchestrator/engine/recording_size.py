"""How large the recording of a run is to be, which the scenario says before it begins.

K sampling times have a sample of each of n robots and the target; the output grid, with `parts` of
each interval and t_0, a state of each robot: K (n + 1) + n (K parts + 1) messages. What links do,
and what agents keep beside estimates, comes on top.
"""

from nrs_cosim.orchestrator.scenario.experiment import Experiment

BYTES = 40
"""Of a recording, for each message: 11,106 of the paper's example are 0.45 MB."""
LARGE = 1e9
"""Bytes, from which on a user is warned."""


def planned_messages(experiment: Experiment) -> int:
    """Return how many samples and states a whole run records."""
    n, clock = experiment.n, experiment.clock
    return clock.ticks * (n + 1) + n * (clock.ticks * clock.parts + 1)


def large_recording(experiment: Experiment) -> str:
    """Say how large a run is, where its recording would be large; else return an empty text."""
    messages = planned_messages(experiment)
    size = BYTES * messages
    if size < LARGE:
        return ""
    return (
        f"a run has {experiment.clock.ticks:,} ticks and {messages:,} messages: a recording of "
        f"about {size / 1e9:.2g} GB; a shorter run.duration makes it smaller"
    )
