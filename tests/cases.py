"""How many random cases a test tries: a part in `make test`, all with `make test-all`."""

import os

ALL = os.environ.get("NRS_TESTS") == "all"


def cases(whole, part):
    """Return which cases, or how many, are tried now."""
    return whole if ALL else part
