"""Of all that comes, the orchestrator takes in what is signed, and short requests to join."""

from nrs_cosim.bus.keys import FMU, JOIN, MISSED, ORDERS, RECORDS, REPORT, SAMPLES, START
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Screen

_LONGEST_HELLO = 2**20
"""Bytes of what a worker says to be let in, which is the one thing that is not signed."""
_ASKED = (START, MISSED, FMU)
_SEALED = (SAMPLES, RECORDS, REPORT, ORDERS, *_ASKED)


def screen_of(signer: Signer) -> Screen:
    """Return what keeps of all that comes only what is signed in the run, and short questions."""

    def screen(key: str, payload: bytes) -> str | None:
        kind = key.partition("/")[0]
        if kind == JOIN:
            return kind if len(payload) > _LONGEST_HELLO else None
        if kind not in _SEALED:
            return "key"
        if signer.verify(key, payload) is not None:
            return None
        return kind if kind in _ASKED else "signature"

    return screen
