"""Zenoh works here when two sessions of this process talk over loopback."""

import queue
import socket

import zenoh

from nrs_cosim.bus.errors import BusError
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session

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
