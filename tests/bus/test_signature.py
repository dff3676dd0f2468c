"""A seal against hashlib's own keyed BLAKE2b of RFC 7693, and what it does not open."""

from hashlib import blake2b

import pytest

from nrs_cosim.bus.signature import SIZE, Signer

SECRET = bytes(range(32))


def test_a_seal_is_the_keyed_digest_of_the_key_and_the_data():
    expected = blake2b(b"samples/left" + b"data", key=SECRET, digest_size=16).digest()
    assert Signer(SECRET).sign("samples/left", b"data") == expected + b"data"
    assert SIZE == 16


@pytest.mark.parametrize("data", [b"", b"d", bytes(1000)])
def test_what_was_signed_is_verified(data):
    signer = Signer(SECRET)
    assert signer.verify("key", signer.sign("key", data)) == data


def test_a_wrong_signature_is_rejected():
    signer = Signer(SECRET)
    payload = signer.sign("key", b"data")
    for bit in range(8 * len(payload)):
        turned = bytearray(payload)
        turned[bit // 8] ^= 1 << bit % 8
        assert signer.verify("key", bytes(turned)) is None
    for cut in range(len(payload)):
        assert signer.verify("key", payload[:cut]) is None
    assert signer.verify("another key", payload) is None
    assert Signer(b"another secret").verify("key", payload) is None


def test_without_a_secret_payloads_are_unsigned():
    assert Signer().sign("key", b"data") == b"data"
    assert Signer().verify("key", b"data") == b"data"
