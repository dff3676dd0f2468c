"""A keyed MAC over (key, payload) proves that its sender holds the run's secret.

It is a BLAKE2b of the key and the bytes under the run's secret, which a worker is given when it
joins (RFC 7693, keyed hashing). Where no socket is open there is no secret, and nothing is signed.
"""

from hashlib import blake2b
from hmac import compare_digest

SIZE = 16
"""Bytes of a signature: nobody comes upon one of 128 bits by chance."""


class Signer:
    """Signs and verifies what travels in one run."""

    def __init__(self, secret: bytes = b"") -> None:
        """Take the run's secret, at most 64 bytes; none where nobody else can put anything."""
        self._secret = secret

    def sign(self, key: str, data: bytes) -> bytes:
        """Return what is to be put on a key."""
        return self._over(key, data) + data if self._secret else data

    def verify(self, key: str, payload: bytes) -> bytes | None:
        """Return what was put on a key, None when its signature is not of it."""
        if not self._secret:
            return payload
        data = payload[SIZE:]
        # In constant time, which tells nobody how much of a guess is right.
        return data if compare_digest(payload[:SIZE], self._over(key, data)) else None

    def _over(self, key: str, data: bytes) -> bytes:
        digest = blake2b(key.encode(), key=self._secret, digest_size=SIZE)
        digest.update(data)
        return digest.digest()
