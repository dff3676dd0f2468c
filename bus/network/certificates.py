"""Three PEM files prove who a session is: an authority, a certificate of it, and its private key.

Zenoh tells a peer that was refused nothing but a timeout, so the same files are put to OpenSSL,
which says what is wrong with them.
"""

import ssl
from dataclasses import dataclass
from pathlib import Path

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted

OPTIONS = {"ca": "--tls-ca", "certificate": "--tls-certificate", "key": "--tls-key"}
_MARKS = {
    "ca": "BEGIN CERTIFICATE-----",
    "certificate": "BEGIN CERTIFICATE-----",
    "key": "PRIVATE KEY-----",
}


@dataclass(frozen=True, slots=True)
class Tls:
    """Paths of PEM files: the authority, one's certificate, and its key without passphrase."""

    ca: Path
    certificate: Path
    key: Path


def context(tls: Tls) -> ssl.SSLContext:
    """Return a client's context of these files; `InputError` names the option, file and fault."""
    for name, mark in _MARKS.items():
        _expect_pem(name, getattr(tls, name), mark)
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    _load(made, "ca", tls.ca)
    _load(ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT), "certificate", tls.certificate)
    try:
        made.load_cert_chain(tls.certificate, tls.key)
    except ssl.SSLError as error:
        if error.reason == "KEY_VALUES_MISMATCH":
            fault = f"is not the key of the certificate {tls.certificate}; give the pair"
        else:
            fault = f"cannot be used with {tls.certificate}: {reason(error)}"
        raise InputError(f"{where('key')}: {tls.key}: {fault}") from None
    return made


def where(name: str) -> str:
    """Return what a user calls one of the three: the option, and the scenario's field."""
    return f"{OPTIONS[name]} (bus.tls.{name})"


def _load(into: ssl.SSLContext, name: str, path: Path) -> None:
    try:
        into.load_verify_locations(path)
    except ssl.SSLError as error:
        raise InputError(
            f"{where(name)}: {path}: holds no certificate that can be read: {reason(error)}"
        ) from None


def _expect_pem(name: str, path: Path, mark: str) -> None:
    try:
        text = path.read_text("ascii", errors="replace")
    except FileNotFoundError:
        raise InputError(f"{where(name)}: {path}: no such file") from None
    except OSError as error:
        raise InputError(f"{where(name)}: {path}: cannot be read: {error.strerror}") from None
    if mark not in text:
        raise InputError(f"{where(name)}: {path}: expected a PEM file that has {quoted(mark)}")
    if name == "key" and "ENCRYPTED" in text:
        raise InputError(
            f"{where(name)}: {path}: wants a passphrase; openssl pkey -in {path} -out key.pem "
            "writes a key without one"
        )


def reason(error: ssl.SSLError) -> str:
    """Return what OpenSSL complains of, in words."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return error.verify_message
    return (error.reason or str(error)).replace("_", " ").lower()
