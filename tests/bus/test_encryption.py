"""A key reads what is encrypted to it, whole and in its place; nobody else does."""

import pytest

from nrs_cosim.bus.encryption import PUBLIC_SIZE, KeyPair, encrypt, expect_public_key
from nrs_cosim.bus.errors import BusError

SMALL_ORDER = [
    "0000000000000000000000000000000000000000000000000000000000000000",
    "0100000000000000000000000000000000000000000000000000000000000000",
    "e0eb7a7c3b41b8ae1656e3faf19fc46ada098deb9c32b1fd866205165f49b800",
    "5f9c95bca3508c24b1d0b1559c83ef5b04445cc4581c8e86d8224eddd09f1157",
    "ecffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff7f",
    "edffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff7f",
    "eeffffffffffffffffffffffffffffffffffffffffffffffffffffffffffff7f",
]
"""Points of Curve25519 whose multiples by any private key are 0."""


@pytest.mark.parametrize("size", [0, 1, 31, 32, 1000, 10**6])
def test_only_the_holder_of_the_private_key_decrypts(size):
    holder, other, data = KeyPair(), KeyPair(), bytes(k % 251 for k in range(size))
    hidden = encrypt(holder.public, "here", data)
    assert holder.decrypt("here", hidden) == data
    assert other.decrypt("here", hidden) is None
    assert holder.decrypt("there", hidden) is None
    assert size < 31 or data not in hidden


def test_encrypting_a_text_twice_gives_different_bytes():
    holder = KeyPair()
    one, two = (encrypt(holder.public, "here", b"x" * 32) for _ in range(2))
    assert one[:PUBLIC_SIZE] != two[:PUBLIC_SIZE]
    assert one[PUBLIC_SIZE:] != two[PUBLIC_SIZE:]


def test_a_changed_cut_or_longer_ciphertext_is_rejected():
    holder = KeyPair()
    hidden = encrypt(holder.public, "here", b"secret")
    for at in (0, PUBLIC_SIZE - 2, PUBLIC_SIZE, len(hidden) - 1):
        flipped = bytearray(hidden)
        flipped[at] ^= 1
        assert holder.decrypt("here", bytes(flipped)) is None
    for wrong in (b"", hidden[:PUBLIC_SIZE], hidden[:-1], hidden + b"x", b"[" * 10_000):
        assert holder.decrypt("here", wrong) is None


@pytest.mark.parametrize(
    "public", [*map(bytes.fromhex, SMALL_ORDER), b"", b"x" * 31, b"x" * 33], ids=bytes.hex
)
def test_a_public_key_of_low_order_is_rejected(public):
    with pytest.raises(BusError, match="public key"):
        expect_public_key(public)
    assert KeyPair().decrypt("here", public + b"x" * 48) is None
