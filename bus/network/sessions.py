"""A session opens, or says in our words why it does not.

It is opened only where there is room for it: Zenoh panics or hangs where there is none. What it
needs is taken for a moment and given back, since no limit says how much of it is left.
"""

import json
import mmap
import os
import queue
import re
import socket
from contextlib import ExitStack
from threading import Event, Thread

import zenoh

from nrs_cosim.bus.errors import BusError, InputError
from nrs_cosim.bus.network.endpoints import Address, Endpoints, zenoh_settings
from nrs_cosim.bus.network.reachability import BRIEFLY, LONG, Obstacle, probe

DESCRIPTORS, THREADS, ADDRESSES = 16, 16, 512 * 2**20
"""How many a session on a network may take; threads reserve addresses for stacks and heaps."""


def expect_room() -> None:
    """Raise `BusError` where this process may not have what a session takes."""
    done, threads = Event(), list[Thread]()
    what, limit = f"{DESCRIPTORS} more file descriptors", "-n"
    try:
        with ExitStack() as stack:
            for _ in range(DESCRIPTORS):
                stack.callback(os.close, os.open(os.devnull, os.O_RDONLY))
        what, limit = f"{ADDRESSES // 2**20} MiB more of addresses", "-v"
        mmap.mmap(-1, ADDRESSES, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, prot=mmap.PROT_READ).close()
        what, limit = f"{THREADS} more threads", "-u"
        # They wait for one another: only threads that are there together show that there is room.
        for _ in range(THREADS):
            thread = Thread(target=done.wait)
            thread.start()
            threads.append(thread)
    except (OSError, RuntimeError, MemoryError) as error:
        why = getattr(error, "strerror", None) or str(error) or "out of memory"
        raise BusError(
            f"no session could be opened: this process may not have {what} ({why}); raise the "
            f"limit: `ulimit {limit}`, or the container's or the cluster's own"
        ) from None
    finally:
        done.set()
        for thread in threads:
            thread.join()


def open_session(
    endpoints: Endpoints, namespace: str | None = None, *, timestamps: bool = False
) -> zenoh.Session:
    """Open a Zenoh session; with a namespace, that stands before all its keys on the wire.

    With `timestamps` messages say when they were put, which those need that are kept for others.

    `InputError` where nothing can be listened on, or certificates are refused; `BusError` where
    what was to be connected to does not answer within `endpoints.wait` s.
    """
    expect_room()
    _expect_no_refusal(endpoints, _findings(endpoints, BRIEFLY))
    config = zenoh.Config()
    settings = zenoh_settings(endpoints)
    if namespace is not None:
        settings["namespace"] = namespace
    if timestamps:
        settings["timestamping/enabled"] = True
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


def _findings(endpoints: Endpoints, patience: float) -> dict[str, Obstacle]:
    """Return what stands in the way to each endpoint to connect to."""
    probed = {
        endpoint: probe(Address.of("--connect", endpoint), endpoints.tls, patience)
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


_PATIENCE = 10.0
_KEY = "nrs/doctor/samples/one"


def try_loopback() -> None:
    """Send a message from a client to a router over loopback; `BusError` says what fails."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    endpoint = (f"tcp/127.0.0.1:{port}",)
    received: queue.Queue[bytes] = queue.Queue()
    with open_session(Endpoints(listen=endpoint, insecure_tcp=True)) as hub:
        hub.declare_subscriber(_KEY, lambda sample: received.put(sample.payload.to_bytes()))
        with open_session(Endpoints(connect=endpoint, insecure_tcp=True)) as client:
            client.put(_KEY, b"x", congestion_control=zenoh.CongestionControl.BLOCK)
            try:
                received.get(timeout=_PATIENCE)
            except queue.Empty:
                raise BusError(f"nothing was received over loopback in {_PATIENCE:g} s") from None
