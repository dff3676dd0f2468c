"""A node of ROS 2 that publishes over Zenoh, as the middleware rmw_zenoh_cpp has it on the wire.

    <domain>/<topic>/<type>/<type hash>                         each message, in CDR
    @ros2_lv/<domain>/<session>/0/0/NN/%/%/<node>               that there is a node, alive
    @ros2_lv/<domain>/<session>/0/<n>/MP/%/%/<node>/<topic>/<type>/<type hash>/<qos>
                                                                and its publisher n

A type is `sensor_msgs::msg::dds_::JointState_`; in what is alive `/` is `%`. A message's attachment
is its number from 1 on and when it was put (ns since 1970), both of 64 bits, little-endian, then 16
and the 16 bytes by which its publisher goes. What is latched is kept for who comes later, by
Zenoh's advanced publishers, as of durability "transient local". A policy is empty where it is the
default.
"""

import struct
from collections.abc import Callable
from contextlib import suppress
from hashlib import sha256
from itertools import count
from time import time_ns
from typing import Any

import zenoh
from zenoh.ext import CacheConfig, declare_advanced_publisher

from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.matching import wait_for_match
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.bus.transport import Put

ALIVE = "@ros2_lv"
_GID_BYTES = 16
_ATTACHMENT = struct.Struct(f"<qqB{_GID_BYTES}s")
_VOLATILE, _LATCHED = "::,10:,:,:,,", ":1:,1:,:,:,,"
"""Reliability, durability, history and depth, deadline, lifespan, liveliness."""


def wire_type(name: str) -> str:
    """Return what a type such as `std_msgs/msg/String` is called on the wire."""
    package, folder, kind = name.split("/")
    return f"{package}::{folder}::dds_::{kind}_"


class RosNode:
    """A node, and the session that it is alive in."""

    def __init__(self, name: str, domain: int, endpoints: Endpoints) -> None:
        """Open a session; `InputError` and `BusError` as `open_session`."""
        self._session = open_session(endpoints, timestamps=True)
        self._name, self._domain = name, domain
        self._declared: list[Any] = []
        self._numbers = count(1)
        self._announce(f"0/NN/%/%/{name}")

    @property
    def pattern(self) -> str:
        """All keys of its domain."""
        return f"{self._domain}/**"

    def publisher(self, topic: str, kind: str, type_hash: str, *, latched: bool) -> Put:
        """Return what puts messages of a type on a topic; reliable, and blocking."""
        name = wire_type(kind)
        about = f"{topic.replace('/', '%')}/{name}/{type_hash}/{_LATCHED if latched else _VOLATILE}"
        token = self._announce(f"{next(self._numbers)}/MP/%/%/{self._name}/{about}")
        gid = sha256(token.encode()).digest()[:_GID_BYTES]
        put = self._put(f"{self._domain}/{topic.lstrip('/')}/{name}/{type_hash}", latched)
        numbers = count(1)

        def put_message(payload: bytes) -> None:
            put(payload, attachment=_ATTACHMENT.pack(next(numbers), time_ns(), _GID_BYTES, gid))

        return put_message

    def wait_for_listener(self, seconds: float) -> bool:
        """Wait until somebody listens on any key of its domain; return whether in time."""
        return wait_for_match(self._session, self.pattern, seconds)

    def close(self) -> None:
        """Take back all that was declared, the last first, and close the session."""
        while self._declared:
            with suppress(zenoh.ZError):  # the link is lost
                self._declared.pop().undeclare()
        self._session.close()  # type: ignore[no-untyped-call]

    def _put(self, key: str, latched: bool) -> Callable[..., None]:
        how: dict[str, Any] = {
            "encoding": zenoh.Encoding.APPLICATION_CDR,
            "congestion_control": zenoh.CongestionControl.BLOCK,
            "reliability": zenoh.Reliability.RELIABLE,
        }
        publisher: Any
        if latched:
            publisher = declare_advanced_publisher(
                self._session, key, cache=CacheConfig(1), publisher_detection=True, **how
            )
        else:
            publisher = self._session.declare_publisher(key, **how)
        self._declared.append(publisher)
        put: Callable[..., None] = publisher.put
        return put

    def _announce(self, what: str) -> str:
        token = f"{ALIVE}/{self._domain}/{self._session.zid()}/0/{what}"
        self._declared.append(self._session.liveliness().declare_token(token))
        return token
