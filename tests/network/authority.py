"""A certificate authority of the tests' own, and certificates by name in a folder."""

from datetime import UTC, datetime
from pathlib import Path

import trustme
from cryptography.hazmat.primitives.serialization import (
    Encoding,
    NoEncryption,
    PrivateFormat,
    load_pem_private_key,
)

from nrs_cosim.bus.network.certificates import Tls

LONG_AGO = datetime(2020, 1, 1, tzinfo=UTC), datetime(2021, 1, 1, tzinfo=UTC)
LOOPBACK = ("127.0.0.1", "localhost")


class Authority:
    """Issues certificates whose files lie in one folder."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder, self._ca = folder, trustme.CA()
        self._ca.cert_pem.write_to_path(folder / "ca.pem")

    def issue(
        self,
        name: str,
        *names: str,
        valid: tuple[datetime | None, datetime | None] = (None, None),
        form: PrivateFormat = PrivateFormat.PKCS8,
    ) -> Tls:
        """Issue a certificate with `name` as its common name, for loopback or the names given."""
        leaf = self._ca.issue_cert(
            *(names or LOOPBACK), common_name=name, not_before=valid[0], not_after=valid[1]
        )
        certificate, key = self.folder / f"{name}.pem", self.folder / f"{name}-key.pem"
        certificate.write_bytes(b"".join(blob.bytes() for blob in leaf.cert_chain_pems))
        private = load_pem_private_key(leaf.private_key_pem.bytes(), None)
        key.write_bytes(private.private_bytes(Encoding.PEM, form, NoEncryption()))
        return Tls(self.folder / "ca.pem", certificate, key)
