"""All errors that are raised on purpose, as one tree; the text of each is complete for a user.

CosimError
├── InputError            what was given is wrong: a file, a field, an argument
│   ├── AlgorithmError      an installed algorithm does not work; a RunError too
│   ├── FmuError            an FMU that cannot be built, found, read or used
│   ├── MissingExtraError   a package that not everybody needs is not installed
│   ├── ScenarioError       a scenario's field or shape
│   ├── StartError          a plant that cannot start where it was told; an FmuError too
│   ├── UncreatableError    no file can be made there
│   └── UnreadableError     the file is no recording
└── RunError              a run that had started could not go on; `cause` says it in fields
    ├── BusError            a message that is missing, or that had to be rejected
    ├── DivergedError       an estimate or a state beyond all bounds
    ├── EngineGoneError     who runs a study's points is gone, and no point is to blame
    ├── WorkerError           a worker that did not come, or is gone for good
    ├── StepError           a plant that could not be stepped
    └── UnwritableError     the disk refused
"""

from nrs_cosim.bus.errors import BusError, CosimError, InputError, MissingExtraError, RunError
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.orchestrator.errors import (
    DivergedError,
    EngineGoneError,
    ScenarioError,
    WorkerError,
)
from nrs_cosim.plant_fmu.errors import FmuError, StartError, StepError
from nrs_cosim.recordings.errors import UncreatableError, UnreadableError, UnwritableError

__all__ = [
    "AlgorithmError",
    "BusError",
    "CosimError",
    "DivergedError",
    "EngineGoneError",
    "FmuError",
    "InputError",
    "MissingExtraError",
    "RunError",
    "ScenarioError",
    "StartError",
    "StepError",
    "UncreatableError",
    "UnreadableError",
    "UnwritableError",
    "WorkerError",
]
