"""What can go wrong with a plant; the whole tree is drawn in `bus.errors`."""

from nrs_cosim.bus.errors import InputError, RunError


class FmuError(InputError):
    """An FMU cannot be found, built, read or used as it is."""


class UnstableStepError(FmuError):
    """A step is beyond what the gains and the plant's inertia let it be."""


class StepError(RunError):
    """An FMU failed while it was stepped."""

    kind = "plant"
