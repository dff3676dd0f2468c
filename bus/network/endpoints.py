"""A session is reached by a Unix socket, by mutual TLS, or by plain TCP that was asked for.

    no endpoint             no socket: mode peer, nobody listens, nobody scouts
    listen                  mode router: the workers meet here
    connect                 mode client: goes on trying for `wait`, and again after a lost link

Plain TCP has to be asked for on loopback too: every user of the machine may connect there, while
a Unix socket is its owner's. Scouting, gossip and shared memory are off. A full queue blocks its
sender; when nothing leaves it for twice as long as a link may be silent, the link is lost. An
endpoint is `protocol/address` alone: Zenoh's own `?` and `#` suffixes could switch off what is
decided here. Certificates are verified whenever a link opens, names included; a link that is open
is not closed because a date has passed.
"""

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.network.access import access_control
from nrs_cosim.bus.network.certificates import Tls, context
from nrs_cosim.bus.text import quoted

NETWORK_LEASE, LOCAL_LEASE = 0.8, 3600.0
"""s; a lost link is noticed within 1 s, and a local process that is stopped is waited for."""

_LONGEST_SOCKET_PATH = 107
"""Bytes: Linux has room for 108 with the 0 at the end (unix(7), sun_path)."""
_LARGEST_MESSAGE = 256 * 2**20
"""Bytes of a message that is let in where one listens; it is whole before it can be judged.

The largest that a worker puts is a tick with a checkpoint of each robot: 8 KiB each for as many as
a recorded run may have.
"""
_FORM = "tls/HOST:PORT, tcp/HOST:PORT or unixsock-stream//absolute/path"


@dataclass(frozen=True, slots=True)
class Endpoints:
    """Where a session listens or what it connects to; with neither it opens no socket.

    `lease` is how long this side may be silent, in s, before the other counts the link as lost; by
    default `NETWORK_LEASE`, or
    `LOCAL_LEASE` where all endpoints are Unix sockets. `wait` is how long, in s, a client tries to
    connect before it gives up. `workers` are the common names of the certificates that may take
    part when TLS is listened on; without any, every certificate of the authority may. `InputError`
    names what is malformed, missing or refused.
    """

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    tls: Tls | None = None
    insecure_tcp: bool = False
    lease: float | None = None
    wait: float = 10.0
    workers: Collection[str] = ()

    def __post_init__(self) -> None:
        if self.listen and self.connect:
            raise InputError(
                f"--connect: {quoted(self.connect[0])} and --listen {quoted(self.listen[0])} "
                "exclude each "
                "other; a run has one place where its workers meet"
            )
        for option, endpoints in (("--listen", self.listen), ("--connect", self.connect)):
            for endpoint in endpoints:
                _expect_allowed(option, Address.of(option, endpoint), self)
        for name, value in (("lease", self.lease), ("--wait", self.wait)):
            if value is not None and not 0.01 <= value <= 1e6:
                raise InputError(f"{name}: expected 0.01 to 1000000 s, got {quoted(value)}")
        if self.tls:
            context(self.tls)

    @property
    def seconds_of_silence(self) -> float:
        """The lease that is in force, in s."""
        if self.lease is not None:
            return self.lease
        local = all(map(_is_socket, self.listen + self.connect))
        return LOCAL_LEASE if local else NETWORK_LEASE


@dataclass(frozen=True, slots=True)
class Address:
    """An endpoint, parsed; `host` is the path of a Unix socket, whose port is 0."""

    protocol: str
    host: str
    port: int
    text: str

    @classmethod
    def of(cls, option: str, text: str) -> "Address":
        """Parse an endpoint; `InputError` names the option that gave it."""
        protocol, slash, rest = text.partition("/")
        wrong = f"{option}: expected {_FORM}, got {quoted(text)}"
        if not slash or protocol not in {"tls", "tcp", "unixsock-stream"}:
            raise InputError(wrong)
        if any(sign in rest for sign in "?#;") or not rest.isprintable() or " " in rest:
            raise InputError(f"{wrong}; nothing may follow the address")
        if protocol == "unixsock-stream":
            return cls(protocol, _socket_path(option, text, rest), 0, text)
        host, colon, port = rest.rpartition(":")
        bracketed = host.startswith("[") and host.endswith("]")
        if not colon or not host or ("/" in host) or (":" in host) != bracketed:
            raise InputError(wrong)
        if not (port.isascii() and port.isdigit() and 1 <= int(port) <= 65535):
            raise InputError(
                f"{option}: expected a port from 1 to 65535, got {quoted(port)} in {quoted(text)}"
            )
        return cls(protocol, host.strip("[]"), int(port), text)


def zenoh_settings(endpoints: Endpoints) -> dict[str, Any]:
    """Return what Zenoh's configuration has at each path, as values for JSON."""
    settings: dict[str, Any] = {
        "mode": "router" if endpoints.listen else "client" if endpoints.connect else "peer",
        "listen/endpoints": list(endpoints.listen),
        "connect/endpoints": list(endpoints.connect),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,
    }
    if not endpoints.listen and not endpoints.connect:
        return settings
    protocols = {text.partition("/")[0] for text in endpoints.listen + endpoints.connect}
    settings |= {
        "transport/link/protocols": sorted(protocols),
        "transport/link/tx/lease": round(endpoints.seconds_of_silence * 1000),
        # Signs of life in a lease: three of them may be late.
        "transport/link/tx/keep_alive": 4,
        # µs, twice the silence: a link that is lost is noticed by its lease first.
        "transport/link/tx/queue/congestion_control/block/wait_before_close": round(
            2e6 * endpoints.seconds_of_silence
        ),
        "connect/timeout_ms": round(endpoints.wait * 1000),
        "connect/exit_on_failure": True,
        "connect/retry": {
            "period_init_ms": 50,
            "period_max_ms": 500,
            "period_increase_factor": 2,
        },
    }
    if endpoints.listen:
        settings["transport/link/rx/max_message_size"] = _LARGEST_MESSAGE
    if endpoints.tls and "tls" in protocols:
        settings |= _tls_settings(endpoints.tls)
        if endpoints.listen and endpoints.workers:
            settings["access_control"] = access_control(endpoints.workers, protocols - {"tls"})
    return settings


def _tls_settings(tls: Tls) -> dict[str, Any]:
    certificate, key = str(tls.certificate.absolute()), str(tls.key.absolute())
    settings = {
        "root_ca_certificate": str(tls.ca.absolute()),
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": False,
    }
    return {f"transport/link/tls/{name}": value for name, value in settings.items()}


def _expect_allowed(option: str, address: Address, endpoints: Endpoints) -> None:
    if address.protocol == "tls" and endpoints.tls is None:
        raise InputError(
            f"{option}: {quoted(address.text)} needs certificates; give --tls-ca, "
            "--tls-certificate and "
            "--tls-key, or bus.tls in the scenario"
        )
    if address.protocol == "tcp" and not endpoints.insecure_tcp:
        raise InputError(
            f"{option}: {quoted(address.text)} is plain TCP, where anyone who reaches it may "
            "listen and "
            "speak, on this machine every user; use tls/… or unixsock-stream/…, or ask for it with "
            "--insecure-tcp"
        )


def _socket_path(option: str, text: str, path: str) -> str:
    if not Path(path).is_absolute() or len(path.encode()) > _LONGEST_SOCKET_PATH:
        raise InputError(
            f"{option}: expected an absolute path of at most {_LONGEST_SOCKET_PATH} bytes after "
            f"unixsock-stream/, got {quoted(text)}"
        )
    if not Path(path).parent.is_dir():
        raise InputError(f"{option}: {quoted(text)} is in a folder that does not exist")
    return path


def _is_socket(endpoint: str) -> bool:
    return endpoint.startswith("unixsock-stream/")
