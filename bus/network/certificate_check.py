"""A certificate is good for a worker when it is signed, in date, and names who and where it is.

The common name is the worker's name on the bus; the alternative names are the addresses by which
others connect to it.
"""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from typing import Literal

from cryptography import x509

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.network.access import RESERVED, expect_worker_name
from nrs_cosim.bus.network.certificates import Tls, context

SOON = timedelta(days=30)
CertificateStatus = Literal["ok", "warning", "fails"]


def vet(tls: Tls, now: datetime | None = None) -> Iterator[tuple[str, CertificateStatus, str]]:
    """Yield what was looked at, the status, and what was seen or is to be done."""
    try:
        context(tls)
    except InputError as error:
        yield "files", "fails", str(error)
        return
    yield "files", "ok", "readable, and the key is the certificate's"
    authorities = x509.load_pem_x509_certificates(tls.ca.read_bytes())
    own, *between = x509.load_pem_x509_certificates(tls.certificate.read_bytes())
    yield _signed(own, between, authorities)
    for what, of in (("dates", [own, *between]), ("authority's dates", authorities)):
        yield what, *_in_date(of, now or datetime.now(UTC))
    yield from _named(own)
    if "BEGIN PRIVATE KEY" in tls.key.read_text("ascii"):
        yield "key", "ok", "PKCS#8"
    else:
        advice = f"openssl pkcs8 -topk8 -nocrypt -in {tls.key} -out key.pem writes one"
        yield "key", "warning", f"not in the form PKCS#8; {advice}"


def common_name(tls: Tls) -> str | None:
    """Return the one common name of a certificate; None where it cannot be told."""
    try:
        own, *_ = x509.load_pem_x509_certificates(tls.certificate.read_bytes())
    except (OSError, ValueError):
        return None
    names = own.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)
    return str(names[0].value) if len(names) == 1 else None


def _signed(
    own: x509.Certificate, between: list[x509.Certificate], authorities: list[x509.Certificate]
) -> tuple[str, CertificateStatus, str]:
    at = own
    for _ in range(len(between) + 1):
        if any(_issued(at, authority) for authority in authorities):
            return "signature", "ok", f"by {at.issuer.rfc4514_string()}"
        issuer = next((one for one in between if one != at and _issued(at, one)), None)
        if issuer is None:
            break
        at = issuer
    said = f"by {at.issuer.rfc4514_string()}, which is not the authority in --tls-ca"
    return "signature", "fails", f"{said}; have the certificate issued by it, or give the other"


def _issued(one: x509.Certificate, by: x509.Certificate) -> bool:
    try:
        one.verify_directly_issued_by(by)
    except Exception:  # by name, by algorithm or by signature, each is an error of another kind
        return False
    return True


def _in_date(certificates: list[x509.Certificate], now: datetime) -> tuple[CertificateStatus, str]:
    begin = max(one.not_valid_before_utc for one in certificates)
    end = min(one.not_valid_after_utc for one in certificates)
    if now < begin:
        return "fails", f"not valid before {begin:%Y-%m-%d %H:%M} UTC; is this clock right?"
    if now > end:
        return "fails", f"expired on {end:%Y-%m-%d %H:%M} UTC; have a new one issued"
    if end - now < SOON:
        return "warning", f"expires on {end:%Y-%m-%d %H:%M} UTC; have a new one issued"
    return "ok", f"until {end:%Y-%m-%d}"


def _named(own: x509.Certificate) -> Iterator[tuple[str, CertificateStatus, str]]:
    names = [str(a.value) for a in own.subject.get_attributes_for_oid(x509.NameOID.COMMON_NAME)]
    yield "worker", *_name_of_a_worker(names)
    try:
        alternative = own.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        addresses = [*alternative.get_values_for_type(x509.DNSName)]
        addresses += map(str, alternative.get_values_for_type(x509.IPAddress))
    except x509.ExtensionNotFound:
        addresses = []
    if addresses:
        yield "addresses", "ok", f"{', '.join(addresses)} (subject alternative names)"
    else:
        advice = "have a certificate issued with the names and addresses of this machine"
        yield "addresses", "fails", f"no subject alternative name; {advice}"


def _name_of_a_worker(names: list[str]) -> tuple[CertificateStatus, str]:
    if len(names) != 1:
        said = f"expected one common name, the worker's, got {len(names)}"
        return "fails", f"{said}; have a certificate issued with one"
    if names[0] in RESERVED:
        return "ok", f"{names[0]} is for the orchestrator; no worker can have it"
    try:
        return "ok", f"{expect_worker_name(names[0], 'common name')} is its name on the bus"
    except InputError as error:
        return "fails", f"{error}; have a certificate issued with such a name"
