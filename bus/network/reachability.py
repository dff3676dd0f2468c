"""Why a link does not open is found out by opening one beside Zenoh, which tells only a timeout.

A TLS client learns that it was refused when it first reads after the handshake (TLS 1.3), so a
probe reads once: silence, which a listener of Zenoh's keeps, means that it was let in.
"""

import socket
import ssl
from contextlib import suppress
from dataclasses import dataclass

from nrs_cosim.bus.network.certificates import Tls, context, reason
from nrs_cosim.bus.network.endpoints import Address

_DEADLINE = 2.0
"""s: how long a link may take to open, on a network that answers at all."""
BRIEFLY, LONG = 0.3, 5.0
"""s; how long a listener is given for its refusal."""
_ALERTS = {
    "certificate required": "it wants a certificate",
    "unknown ca": "it does not know the authority of this certificate",
    "certificate expired": "this certificate has expired, or is not yet valid, by its clock",
    "bad certificate": "this certificate does not satisfy it",
    "certificate unknown": "this certificate does not satisfy it",
    "unsupported certificate": "this certificate is not made for TLS clients",
    "decrypt error": "it does not know the authority of this certificate",
    "access denied": "it denies access",
}


@dataclass(frozen=True, slots=True)
class Obstacle:
    """What a probe met. `final` means that waiting does not mend it."""

    text: str
    final: bool


def probe(address: Address, tls: Tls | None, patience: float) -> Obstacle | None:
    """Return what stands in the way to an address; None if none refused within `patience` s."""
    try:
        with _connected(address) as link:
            if address.protocol != "tls" or tls is None:
                return None
            return _shaken(link, address, tls, patience)
    except socket.gaierror:
        return Obstacle(f"the name {address.host} is not known", final=False)
    except (TimeoutError, BlockingIOError):
        return Obstacle(
            "no answer; check the address, and whether a firewall blocks the port", False
        )
    except (ConnectionRefusedError, FileNotFoundError):
        return Obstacle("nothing listens there; start `nrs run` with --listen first", final=False)
    except OSError as error:
        return Obstacle(f"{error.strerror or error}", final=False)


def _connected(address: Address) -> socket.socket:
    if address.protocol != "unixsock-stream":
        return socket.create_connection((address.host, address.port), timeout=_DEADLINE)
    link = socket.socket(socket.AF_UNIX)
    try:
        link.settimeout(_DEADLINE)
        link.connect(address.host)
    except OSError:
        link.close()
        raise
    return link


def _shaken(link: socket.socket, address: Address, tls: Tls, patience: float) -> Obstacle | None:
    """Return why a TLS handshake fails, on this side or the other."""
    try:
        with (
            context(tls).wrap_socket(link, server_hostname=address.host) as shaken,
            suppress(TimeoutError),
        ):
            shaken.settimeout(patience)
            shaken.recv(1)
    except ssl.SSLCertVerificationError as error:
        return Obstacle(f"its certificate is refused here: {error.verify_message}", final=True)
    except ssl.SSLError as error:
        said = reason(error)
        for alert, meaning in _ALERTS.items():
            if said.endswith(f"alert {alert}"):
                return Obstacle(f"this certificate ({tls.certificate}) is refused: {meaning}", True)
        return Obstacle(f"no TLS is spoken with it: {said}", final=False)
    except TimeoutError:
        return Obstacle("no TLS is spoken with it: it is silent", final=False)
    except (ConnectionResetError, BrokenPipeError):
        return Obstacle(f"it ended the handshake; it may refuse {tls.certificate}", final=False)
    return None
