"""What is encrypted to a public key is read by the holder of its private key alone.

Each text has a key pair of its own (X25519, RFC 7748); what both ends then share gives, by HKDF
(RFC 5869) over both public keys, the one key of ChaCha20-Poly1305 (RFC 8439), which signs the place
along with the text. Who holds a key is not told by it, only that it is one and the same party.
"""

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDF

from nrs_cosim.bus.errors import BusError

PUBLIC_SIZE = 32
"""Bytes of a public key."""
_KEY_SIZE = 32
_NONCE = bytes(12)
"""A key encrypts one text alone, so that the nonce need not change."""


class KeyPair:
    """A private key, drawn anew, and its public key."""

    def __init__(self) -> None:
        self._private = X25519PrivateKey.generate()
        self.public = self._private.public_key().public_bytes_raw()

    def decrypt(self, where: str, data: bytes) -> bytes | None:
        """Return what was encrypted to this key for a place; None when nothing was."""
        # What is too short, or a point of small order, is as good as what another key encrypted.
        theirs, hidden = data[:PUBLIC_SIZE], data[PUBLIC_SIZE:]
        try:
            return self.cipher(theirs, theirs + self.public).decrypt(_NONCE, hidden, where.encode())
        except (InvalidTag, ValueError):
            return None

    def cipher(self, theirs: bytes, context: bytes) -> ChaCha20Poly1305:
        """Return what the holder of a public key has too; `ValueError` for what is none."""
        shared = self._private.exchange(X25519PublicKey.from_public_bytes(theirs))
        derived = HKDF(SHA256(), _KEY_SIZE, None, context)
        return ChaCha20Poly1305(derived.derive(shared))


def encrypt(public: bytes, where: str, data: bytes) -> bytes:
    """Return data for the holder of a public key, at a place."""
    own = KeyPair()
    return own.public + own.cipher(public, own.public + public).encrypt(
        _NONCE, data, where.encode()
    )


def expect_public_key(data: bytes) -> None:
    """Raise `BusError` for what is no public key, as points of small order are none."""
    try:
        KeyPair().cipher(data, b"")
    except ValueError:
        raise BusError("its public key is not an X25519 key") from None
