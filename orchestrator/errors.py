"""What the orchestrator itself finds wrong; the whole tree is drawn in `bus.errors`."""

from nrs_cosim.bus.errors import CosimError, InputError, RunError


class ScenarioError(InputError):
    """A scenario file is missing, malformed, or has a wrong field; one line for each."""


class DivergedError(RunError):
    """An estimate or a robot's state went beyond the scenario's divergence limit."""

    kind = "diverged"


class WorkerError(RunError):
    """A worker did not come, or is gone and is not started again."""

    kind = "worker"


class EngineGoneError(RunError):
    """Whoever runs the points of a study is gone, and none of them is to blame."""


class Interrupted(CosimError):  # noqa: N818, it is no error of the run's
    """The user asked a run to end."""
