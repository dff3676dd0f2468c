"""A key of RFC 7919's group ffdhe2048 reads what is encrypted to it, whole and in its place."""

from fractions import Fraction
from math import factorial

import pytest

from bus import encryption
from bus.encryption import PUBLIC_SIZE, KeyPair, encrypt, expect_public_key

P = encryption._P


def test_the_modulus_is_that_of_the_standards_formula():
    """p = 2^2048 - 2^1984 + (floor(2^1918 e) + 560316) 2^64 - 1 (RFC 7919, appendix A.1)."""
    e = sum((Fraction(1, factorial(k)) for k in range(400)), Fraction())
    floor = e.numerator * 2**1918 // e.denominator
    assert 2**2048 - 2**1984 + (floor + 560316) * 2**64 - 1 == P


@pytest.mark.parametrize("size", [0, 1, 31, 32, 1000, 10**6])
def test_the_holder_of_the_private_key_alone_reads_it(size):
    holder, other, data = KeyPair(), KeyPair(), bytes(k % 251 for k in range(size))
    hidden = encrypt(holder.public, "here", data)
    assert holder.decrypt("here", hidden) == data
    assert other.decrypt("here", hidden) is None
    assert holder.decrypt("there", hidden) is None
    assert size < 31 or data not in hidden


def test_no_text_is_encrypted_twice_to_the_same_bytes():
    holder = KeyPair()
    one, two = (encrypt(holder.public, "here", b"x" * 32) for _ in range(2))
    assert one[:PUBLIC_SIZE] != two[:PUBLIC_SIZE]
    assert one[PUBLIC_SIZE:] != two[PUBLIC_SIZE:]


def test_a_changed_cut_or_longer_text_is_none():
    holder = KeyPair()
    hidden = encrypt(holder.public, "here", b"secret")
    for at in (0, PUBLIC_SIZE - 1, PUBLIC_SIZE, len(hidden) - 1):
        flipped = bytearray(hidden)
        flipped[at] ^= 1
        assert holder.decrypt("here", bytes(flipped)) is None
    for wrong in (b"", hidden[:PUBLIC_SIZE], hidden[:-1], hidden + b"x", b"[" * 10_000):
        assert holder.decrypt("here", wrong) is None


@pytest.mark.parametrize("value", [0, 1, P - 1, P, P + 1, 2**2048 - 1])
def test_numbers_whose_powers_are_known_are_no_public_keys(value):
    public = value.to_bytes(PUBLIC_SIZE)
    with pytest.raises(ValueError, match="no public key"):
        expect_public_key(public)
    assert KeyPair().decrypt("here", public + b"x" * 48) is None
