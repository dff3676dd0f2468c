"""Every error is raised where it is known and shown once, by the command line.

CosimError
├── Interrupted           orchestrator: the user asked a run to end                (exit 130)
├── InputError            what the user gave is wrong: a file, a field, an option   (exit 2)
│   ├── AlgorithmError      estimator_agents: another package's does not work; a RunError too
│   ├── FmuError            plant_fmu: an FMU that cannot be built, found, read or used
│   ├── MissingExtraError   a package that not everybody needs is not installed
│   ├── ScenarioError       orchestrator: a scenario's field or shape
│   ├── UncreatableError    recordings: no file can be made there
│   └── UnreadableError     recordings: the file is no recording
└── RunError              a run that had started could not go on                    (exit 1)
    ├── BusError            a message that is missing, or that had to be refused
    ├── DivergedError       orchestrator: an estimate or a state beyond all bounds
    ├── EngineGoneError     orchestrator: who runs a study's points is gone; no point is to blame
    ├── WorkerError         orchestrator: a worker that did not come, or is gone for good
    ├── StepError           plant_fmu: a plant that could not be stepped
    └── UnwritableError     recordings: the disk refused
"""

from dataclasses import dataclass
from typing import Literal

Kind = Literal[
    "diverged", "plant", "algorithm", "worker", "deadline", "bus", "disk", "interrupted", "other"
]


@dataclass(frozen=True, slots=True)
class Cause:
    """What ended a run before its last tick, for programs; None is what is not known."""

    kind: Kind
    tick: int | None = None
    """The one that did not close; of a run that the user stopped, the last that did."""
    time_ns: int | None = None
    robot: int | None = None
    quantity: str | None = None


class CosimError(Exception):
    """Any error that this project raises on purpose; its text is complete for a user."""


class InputError(CosimError):
    """The user's input is wrong; the text names the field or file, the value and what to do."""


class MissingExtraError(InputError):
    """Something needs packages of an extra that is not installed."""

    def __init__(self, need: str, extra: str) -> None:
        """Say what needs which package, and which extra brings it."""
        super().__init__(
            f"{need}, which is not installed: pip install '.[{extra}]' in nrs-cosim's sources"
        )


class RunError(CosimError):
    """A run failed after it had started; the text names who, when and why."""

    kind: Kind = "other"

    def __init__(self, text: str, cause: Cause | None = None) -> None:
        super().__init__(text)
        self.cause = cause or Cause(self.kind)


class BusError(RunError):
    """A message did not arrive, or arrived where, when or as it must not."""

    kind = "bus"
