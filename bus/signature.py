"""A seal says that bytes were put on a key by one who was let into the run.

It is a BLAKE2b of the key and the bytes under the run's secret, which a worker is told when it
joins (RFC 7693, keyed hashing). Where no socket is open there is no secret, and nothing to seal
against.
"""

from hashlib import blake2b
from hmac import compare_digest

SIZE = 16


class Seal:
    """Seals and opens what travels in one run."""

    def __init__(self, secret: bytes = b"") -> None:
        """Take the run's secret, at most 64 bytes; none where nobody else can put anything."""
        self._secret = secret

    def closed(self, key: str, data: bytes) -> bytes:
        """Return what is to be put on a key."""
        return self._over(key, data) + data if self._secret else data

    def opened(self, key: str, payload: bytes) -> bytes | None:
        """Return what was put on a key, None when it was not sealed for it."""
        if not self._secret:
            return payload
        data = payload[SIZE:]
        return data if compare_digest(payload[:SIZE], self._over(key, data)) else None

    def _over(self, key: str, data: bytes) -> bytes:
        digest = blake2b(key.encode(), key=self._secret, digest_size=SIZE)
        digest.update(data)
        return digest.digest()
