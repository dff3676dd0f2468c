"""What can be wrong with an algorithm; the whole tree is drawn in `bus.errors`."""

import inspect
from contextlib import suppress
from typing import Any

from nrs_cosim.bus.errors import InputError, RunError


class AlgorithmError(InputError, RunError):
    """An algorithm of another package does not work: bad input, or the end of a run that began."""

    kind = "algorithm"


def written_at(source: Any) -> str:
    """Return where in a package's code a class or method begins; nothing where it is not known."""
    with suppress(OSError, TypeError):
        return f", at {inspect.getsourcefile(source)}:{inspect.getsourcelines(source)[1]}"
    return ""
