"""Arrays on their way into a page: base64 of their little-endian bytes, each content once."""

from base64 import b64encode
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Arrays:
    """The arrays of a page by number; `encoded` is what the page decodes them from."""

    def __init__(self) -> None:
        self.encoded: list[dict[str, str]] = []
        self._known: dict[tuple[str, bytes], int] = {}

    def put(self, array: NDArray[Any]) -> int:
        """Return the number of an array of floats, of any shape; doubles are kept bit by bit."""
        kind = "f4" if array.dtype == np.float32 else "f8"
        data = np.ascontiguousarray(array, f"<{kind}").tobytes()
        if (kind, data) not in self._known:
            self._known[kind, data] = len(self.encoded)
            self.encoded.append({"kind": kind, "data": b64encode(data).decode("ascii")})
        return self._known[kind, data]
