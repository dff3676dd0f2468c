"""What can be wrong with an algorithm; the whole tree is drawn in `bus.errors`."""

from nrs_cosim.bus.errors import InputError, RunError


class AlgorithmError(InputError, RunError):
    """An algorithm of another package does not work: bad input, or the end of a run that began."""

    kind = "algorithm"
