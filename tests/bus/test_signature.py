"""A seal against hashlib's own keyed BLAKE2b of RFC 7693, and what it does not open."""

from hashlib import blake2b

import pytest

from nrs_cosim.bus.signature import SIZE, Seal

SECRET = bytes(range(32))


def test_a_seal_is_the_keyed_digest_of_the_key_and_the_data():
    expected = blake2b(b"samples/left" + b"data", key=SECRET, digest_size=16).digest()
    assert Seal(SECRET).closed("samples/left", b"data") == expected + b"data"
    assert SIZE == 16


@pytest.mark.parametrize("data", [b"", b"d", bytes(1000)])
def test_what_was_closed_is_opened(data):
    seal = Seal(SECRET)
    assert seal.opened("key", seal.closed("key", data)) == data


def test_what_was_not_sealed_so_is_not_opened():
    seal = Seal(SECRET)
    payload = seal.closed("key", b"data")
    for bit in range(8 * len(payload)):
        turned = bytearray(payload)
        turned[bit // 8] ^= 1 << bit % 8
        assert seal.opened("key", bytes(turned)) is None
    for cut in range(len(payload)):
        assert seal.opened("key", payload[:cut]) is None
    assert seal.opened("another key", payload) is None
    assert Seal(b"another secret").opened("key", payload) is None


def test_without_a_secret_everything_is_as_it_was_put():
    assert Seal().closed("key", b"data") == b"data"
    assert Seal().opened("key", b"data") == b"data"
