"""A session opens, or says in our words why it does not."""

import json

import zenoh

from bus.endpoints import Address, Endpoints, zenoh_settings
from bus.errors import BusError, InputError
from bus.reaching import Finding, probe


def open_session(endpoints: Endpoints, namespace: str | None = None) -> zenoh.Session:
    """Open a Zenoh session; with a namespace, that stands before all its keys on the wire.

    `InputError` where nothing can be listened on, or certificates are refused; `BusError` where
    what was to be connected to does not answer within `endpoints.wait` s.
    """
    for found, endpoint in _findings(endpoints):
        if found.final:
            raise InputError(f"--connect: {endpoint}: {found.text}")
    config = zenoh.Config()
    settings = zenoh_settings(endpoints)
    if namespace is not None:
        settings["namespace"] = namespace
    for path, value in settings.items():
        config.insert_json5(path, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError as error:
        if endpoints.listen:
            raise InputError(f"--listen: {', '.join(endpoints.listen)}: {_cause(error)}") from None
        if endpoints.connect:
            raise _not_reached(endpoints, error) from None
        raise BusError(f"no session could be opened: {_cause(error)}") from None


def _not_reached(endpoints: Endpoints, error: zenoh.ZError) -> BusError | InputError:
    findings = _findings(endpoints)
    for found, endpoint in findings:
        if found.final:
            return InputError(f"--connect: {endpoint}: {found.text}")
    told = [f"{endpoint}: {found.text}" for found, endpoint in findings]
    why = "; ".join(told) or (
        f"{', '.join(endpoints.connect)}: something answers that is no Zenoh router, or it is too "
        f"busy ({_cause(error)})"
    )
    return BusError(f"no connection within {endpoints.wait:g} s: {why}")


def _findings(endpoints: Endpoints) -> list[tuple[Finding, str]]:
    """Return what stands in the way to each endpoint to connect to."""
    probed = [(probe(Address.of("--connect", e), endpoints.tls), e) for e in endpoints.connect]
    return [(found, endpoint) for found, endpoint in probed if found]


def _cause(error: Exception) -> str:
    """Return an error of Zenoh's without the places in its source."""
    return str(error).partition(" at /")[0].rstrip(".")
