"""What a recording says of its run, with the theory beside it: one result, whoever shows it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from nrs_cosim.orchestrator.analysis.comparison import TheoryComparison, compare_to_theory
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
    theory: TheoryComparison

    @classmethod
    def of(cls, reader: Reader, experiment: Experiment) -> "Result":
        """Read the recording of an experiment."""
        measured = measure(reader, experiment)
        theory = compare_to_theory(reader, experiment, measured)
        return cls(describe(reader, experiment), measured, theory)

    def as_json(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {**self.described, "theory": self.theory.as_json()}

    def lines(self) -> dict[str, str]:
        """Return what a person reads of the run, as short lines by name."""
        return lines(self.described, self.measured)
