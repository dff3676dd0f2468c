"""What is encrypted to a public key is read by the holder of its private key alone.

Diffie-Hellman in the group ffdhe2048 (RFC 7919): of exponents x and y, both find g^(x y) mod p from
g^x and g^y, which anyone may hear. Each text is encrypted under a fresh y: the stream is SHAKE256,
the signature `bus.seal`'s, each under a key of its own. Who holds a key is not told by it, only
that it is one and the same party.
"""

from hashlib import blake2b, shake_256
from secrets import randbits

from bus.seal import Seal

_P = int(
    """
    FFFFFFFF FFFFFFFF ADF85458 A2BB4A9A AFDC5620 273D3CF1 D8B9C583 CE2D3695 A9E13641 146433FB
    CC939DCE 249B3EF9 7D2FE363 630C75D8 F681B202 AEC4617A D3DF1ED5 D5FD6561 2433F51F 5F066ED0
    85636555 3DED1AF3 B557135E 7F57C935 984F0C70 E0E68B77 E2A689DA F3EFE872 1DF158A1 36ADE735
    30ACCA4F 483A797A BC0AB182 B324FB61 D108A94B B2C8E3FB B96ADAB7 60D7F468 1D4F42A3 DE394DF4
    AE56EDE7 6372BB19 0B07A7C8 EE0A6D70 9E02FCE1 CDF7E2EC C03404CD 28342F61 9172FE9C E98583FF
    8E4F1232 EEF28183 C3FE3B1B 4C6FAD73 3BB5FCBC 2EC22005 C58EF183 7D1683B2 C6F34A26 C1B2EFFA
    886B4238 61285C97 FFFFFFFF FFFFFFFF
    """.replace("\n", " ").replace(" ", ""),
    16,
)
_G = 2
PUBLIC_SIZE = 256
"""Bytes of a public key."""
_EXPONENT_BITS = 256
"""At least 225 for this group (RFC 7919, section 5.2)."""


class KeyPair:
    """A private key, drawn anew, and its public key."""

    def __init__(self) -> None:
        self._exponent = randbits(_EXPONENT_BITS) | 1 << (_EXPONENT_BITS - 1)
        self.public = pow(_G, self._exponent, _P).to_bytes(PUBLIC_SIZE)

    def decrypt(self, where: str, data: bytes) -> bytes | None:
        """Return what was encrypted to this key for a place; None when nothing was."""
        theirs, sealed = data[:PUBLIC_SIZE], data[PUBLIC_SIZE:]
        try:
            expect_public_key(theirs)
        except ValueError:
            return None
        stream, seal = self.keys_with(theirs, theirs + self.public)
        hidden = seal.opened(where, sealed)
        return None if hidden is None else _masked(stream, hidden)

    def keys_with(self, theirs: bytes, context: bytes) -> tuple[bytes, Seal]:
        """Return the keys shared with the holder of a public key: of the stream, the signature."""
        shared = pow(int.from_bytes(theirs), self._exponent, _P).to_bytes(PUBLIC_SIZE)
        stream, signing = (
            blake2b(shared + context, digest_size=32, person=use).digest()
            for use in (b"stream", b"signature")
        )
        return stream, Seal(signing)


def encrypt(public: bytes, where: str, data: bytes) -> bytes:
    """Return data for the holder of a public key, at a place."""
    own = KeyPair()
    stream, seal = own.keys_with(public, own.public + public)
    return own.public + seal.closed(where, _masked(stream, data))


def expect_public_key(data: bytes) -> bytes:
    """Return a public key; `ValueError` for what is none, as 0, 1 and p − 1 are.

    Their powers are known to all (RFC 7919, section 5.1).
    """
    if len(data) != PUBLIC_SIZE or not 1 < int.from_bytes(data) < _P - 1:
        raise ValueError("is no public key of the group ffdhe2048")
    return data


def _masked(key: bytes, data: bytes) -> bytes:
    stream = shake_256(key).digest(len(data))
    return (int.from_bytes(data) ^ int.from_bytes(stream)).to_bytes(len(data))
