"""Text that can be stored and sent is UTF-8; names from a file system need not be.

Python keeps a byte that is no UTF-8 as half of a surrogate pair, which no encoder takes. Where such
a name becomes a part of a record or a message, the byte is written out as `\\\\udcff`.
"""


def storable(text: str) -> str:
    """Return a text with what cannot be encoded as an escape."""
    return text.encode(errors="backslashreplace").decode()
