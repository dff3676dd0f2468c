"""Of all that comes, the orchestrator takes in what is sealed, and short requests to join."""

from nrs_cosim.bus.keys import FMU, HEARD, JOIN, ORDERS, RECORDS, REPORT, SAMPLES, START
from nrs_cosim.bus.signature import Seal
from nrs_cosim.bus.transport import Screen

_LONGEST_HELLO = 2**20
"""Bytes of what a worker says to be let in, which is the one thing that is not sealed."""
_ASKED = (START, HEARD, FMU)
_SEALED = (SAMPLES, RECORDS, REPORT, ORDERS, *_ASKED)


def screen_of(seal: Seal) -> Screen:
    """Return what keeps of all that comes only what is under a run's seal, and short questions."""

    def screen(key: str, payload: bytes) -> str | None:
        kind = key.partition("/")[0]
        if kind == JOIN:
            return kind if len(payload) > _LONGEST_HELLO else None
        if kind not in _SEALED:
            return "key"
        if seal.opened(key, payload) is not None:
            return None
        return kind if kind in _ASKED else "seal"

    return screen
