"""What a recording says of its run, with the theory beside it: one result, whoever shows it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nrs_cosim.orchestrator.analysis.comparison import Judgement, judge
from nrs_cosim.orchestrator.engine.summary import describe, lines, measure
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import SteadyState


@dataclass(frozen=True, slots=True)
class Result:
    """A run, as it was recorded."""

    described: Mapping[str, Any]
    """What the recording says of itself; see `orchestrator.engine.summary.describe`."""
    measured: SteadyState
    judged: Judgement

    @classmethod
    def of(cls, reader: Reader, experiment: Experiment) -> "Result":
        """Read the recording of an experiment."""
        measured = measure(reader, experiment)
        judged = judge(reader, experiment, measured)
        return cls(describe(reader, experiment), measured, judged)

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {**self.described, "theory": self.judged.as_json()}

    def lines(self) -> dict[str, str]:
        """Return what a person reads of the run, as short lines by name."""
        return lines(self.described, self.measured)
