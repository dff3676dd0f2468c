"""A run that comes to its end measures its last fifth as it is recorded, and says so at the end.

What is said is what the recording's messages give, to the last bit, so that nobody has to read them
for it.
"""

from collections.abc import Sequence
from dataclasses import asdict

import numpy as np

from nrs_cosim.bus.validation import Records
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.measurement import Meter
from nrs_cosim.recordings.metadata import MEASURED, MeasuredRecord

_TOGETHER = 4096
"""States that are measured at once, about."""


class LastFifth:
    """Takes the states of ticks as they close."""

    def __init__(self, experiment: Experiment) -> None:
        end = experiment.clock.t(experiment.clock.ticks)
        self._first = experiment.clock.since(end - end // 5)
        self._meter = Meter(experiment.target_at, experiment.byzantine, end - end // 5)
        self._waiting: list[Records] = []

    def take(self, states: Sequence[Records]) -> None:
        """Take all states (rows,) of a tick, or of some ticks, of each worker."""
        if len(states[0]) and states[0]["k"][-1] >= self._first:
            self._waiting.append(np.concatenate(states))  # what it is a copy of may be used again
            if sum(map(len, self._waiting)) >= _TOGETHER:
                self._measure()

    def _measure(self) -> None:
        if self._waiting:
            found = np.concatenate(self._waiting)
            self._meter.take(found[np.argsort(found["time_ns"], kind="stable")])
            self._waiting.clear()

    def said(self) -> dict[str, str]:
        """Return what is said at the end; nothing where what was measured is not finite."""
        self._measure()
        found = asdict(self._meter.found())
        numbers = [number for number in found.values() if isinstance(number, float)]
        if not np.isfinite(numbers).all():
            return {}
        return {MEASURED: MeasuredRecord.model_validate(found).model_dump_json()}
