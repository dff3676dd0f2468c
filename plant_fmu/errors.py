"""What can go wrong with a plant; the whole tree is drawn in `bus.errors`."""

from collections.abc import Mapping

from nrs_cosim.bus.errors import InputError, RunError


class FmuError(InputError):
    """An FMU cannot be found, built, read or used as it is."""


class StartError(FmuError):
    """A plant does not start where it was told to."""

    def __init__(self, text: str, instead: Mapping[str, tuple[str, ...]]) -> None:
        super().__init__(text)
        self.instead = instead
        """Names of variables that may say where it starts, by ours."""


class StillError(FmuError):
    """Nothing moves, whatever torque is given."""


class UnstableStepError(FmuError):
    """A step is beyond what the gains and the plant's inertia let it be."""


def before_run(doing: str) -> str:
    """Say when a plant failed that was tried out, as the end of a sentence."""
    return f"; that was before the run, while {doing}: nothing is recorded"


class StepError(RunError):
    """An FMU failed while it was stepped."""

    kind = "plant"
