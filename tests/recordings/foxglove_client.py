"""A client of Foxglove's WebSocket protocol, written from its specification alone."""

import json
import struct
from base64 import b64decode

import pytest

from tests.guard import GUARD, VAIN

websockets = pytest.importorskip("websockets.sync.client", reason="needs websockets, of `test`")
PROTOCOL = "foxglove.sdk.v1"
PLAY, PAUSE = 0, 1
DATA, TIME, ASSET, PLAYBACK = 1, 2, 4, 5
STATUSES = ("playing", "paused", "buffering", "ended")


class Client:
    """A connection, what it has been told, and the messages that came."""

    def __init__(self, address):
        self._connection = websockets.connect(
            address,
            subprotocols=[PROTOCOL],
            max_size=None,
            compression=None,
            close_timeout=VAIN,  # by which a client that reads nothing leaves
        )
        self.channels, self.times, self.statuses = {}, [], []
        """Channels by their topics."""
        self.messages = []
        """Topic, log time and bytes."""
        self.assets = {}
        """Bytes by request, None where there are none."""
        self.playback = []
        """Status, time, speed, whether it was sought, and the request."""

    def __enter__(self):
        self._socket = self._connection.__enter__()
        self.info = json.loads(self._socket.recv(GUARD))
        return self

    def __exit__(self, *error):
        self._connection.__exit__(*error)

    def close(self):
        """Leave."""
        self._socket.close()

    def send(self, op, **fields):
        self._socket.send(json.dumps({"op": op, **fields}))

    def subscribe(self, topics):
        """Subscribe to topics that are offered, by the numbers of their channels."""
        numbers = [self.channels[topic]["id"] for topic in topics]
        self.send("subscribe", subscriptions=[{"id": n, "channelId": n} for n in numbers])

    def control(self, command, speed, seek_ns=None, request="a"):
        sought = seek_ns is not None
        head = struct.pack("<BBfBQI", 3, command, speed, sought, seek_ns or 0, len(request))
        self._socket.send(head + request.encode())

    def answer(self, request):
        """Wait for the answer to a request, and return it."""
        found = []
        self.until(lambda: found.extend(p for p in self.playback if p[-1] == request) or found)
        return found[0]

    def until(self, condition):
        """Take what comes until a condition holds."""
        while not condition():
            self._take(self._socket.recv(GUARD))
        return self

    def _take(self, message):
        if isinstance(message, str):
            said = json.loads(message)
            if said["op"] == "advertise":
                self.channels |= {channel["topic"]: channel for channel in said["channels"]}
            elif said["op"] == "status":
                self.statuses.append(said)
            return
        match message[0]:
            case 1:
                number, time_ns = struct.unpack_from("<IQ", message, 1)
                topic = next(t for t, c in self.channels.items() if c["id"] == number)
                self.messages.append((topic, time_ns, message[13:]))
            case 2:
                self.times += struct.unpack_from("<Q", message, 1)
            case 4:
                request, failed, length = struct.unpack_from("<IBI", message, 1)
                self.assets[request] = None if failed else message[10 + length :]
            case 5:
                status, time_ns, speed, sought, length = struct.unpack_from("<BQfBI", message, 1)
                request = message[19 : 19 + length].decode()
                self.playback.append((STATUSES[status], time_ns, speed, bool(sought), request))


def schema_of(channel):
    """Return the bytes of a channel's schema."""
    return b64decode(channel["schema"])
