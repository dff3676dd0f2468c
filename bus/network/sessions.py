"""A session opens, or says in our words why it does not."""

import json
import re

import zenoh

from nrs_cosim.bus.errors import BusError, InputError
from nrs_cosim.bus.network.endpoints import Address, Endpoints, zenoh_settings
from nrs_cosim.bus.network.reachability import BRIEFLY, LONG, Obstacle, probe
from nrs_cosim.bus.network.room import expect_room


def open_session(endpoints: Endpoints, namespace: str | None = None) -> zenoh.Session:
    """Open a Zenoh session; with a namespace, that stands before all its keys on the wire.

    `InputError` where nothing can be listened on, or certificates are refused; `BusError` where
    what was to be connected to does not answer within `endpoints.wait` s.
    """
    expect_room()
    _expect_no_refusal(endpoints, _findings(endpoints, BRIEFLY))
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


def _not_reached(endpoints: Endpoints, error: zenoh.ZError) -> BusError:
    findings = _findings(endpoints, LONG)
    _expect_no_refusal(endpoints, findings)
    why = "; ".join(f"{endpoint}: {found.text}" for endpoint, found in findings.items()) or (
        f"{', '.join(endpoints.connect)}: something answers that is no Zenoh router, or it is too "
        f"busy ({_cause(error)})"
    )
    return BusError(f"no connection within {endpoints.wait:g} s: {why}")


def _findings(endpoints: Endpoints, hearing: float) -> dict[str, Obstacle]:
    """Return what stands in the way to each endpoint to connect to."""
    probed = {
        endpoint: probe(Address.of("--connect", endpoint), endpoints.tls, hearing)
        for endpoint in endpoints.connect
    }
    return {endpoint: found for endpoint, found in probed.items() if found}


def _expect_no_refusal(endpoints: Endpoints, findings: dict[str, Obstacle]) -> None:
    """Do not wait where waiting mends nothing: all endpoints refuse, or are refused."""
    final = {endpoint: found.text for endpoint, found in findings.items() if found.final}
    if final and len(final) == len(endpoints.connect):
        raise InputError("\n".join(f"--connect: {e}: {text}" for e, text in final.items()))


def _cause(error: Exception) -> str:
    """Return the system's reason in an error of Zenoh's, or all but the places in its source."""
    found = re.search(r"([^:\[\]]+) \(os error \d+\)", str(error))
    return found[1].strip() if found else str(error).partition(" at /")[0].rstrip(".")
