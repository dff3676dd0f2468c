"""Sessions reach each other over a wire, also one that loses packets, and notice when it is cut."""

import json
from dataclasses import asdict

import pytest

from tests.cases import cases
from tests.guard import GUARD
from tests.network.authority import Authority
from tests.network.namespaces import two_machines

PORT = 7447
MESSAGES = 200
LEASE = 3.0
"""s; more than the default, for a machine that is busy with other things."""

ENDPOINTS = """
import json, sys
from pathlib import Path
from nrs_cosim.bus.network.certificates import Tls
from nrs_cosim.bus.network.endpoints import Endpoints

arguments = json.loads(sys.argv[1])
if arguments.get("tls"):
    arguments["tls"] = Tls(*map(Path, arguments["tls"]))
for side in ("listen", "connect"):
    arguments[side] = tuple(arguments.get(side, ()))
endpoints = Endpoints(**arguments)
"""

NODE = (
    ENDPOINTS
    + """
import queue, zenoh
from nrs_cosim.bus.network.sessions import open_session

session = open_session(endpoints)
block = zenoh.CongestionControl.BLOCK
"""
)

HUB = (
    NODE
    + """
events = queue.Queue()
watch = session.liveliness().declare_subscriber(
    "nrs/r/alive/*", lambda s: events.put(f"{s.kind} {s.key_expr}"))
echo = session.declare_queryable("nrs/r/start/*", lambda q: q.reply(q.key_expr, b"go"))
received = session.declare_subscriber(
    "nrs/r/samples/*",
    lambda s: session.put("nrs/r/orders/left", s.payload, congestion_control=block))
print("open")
print(events.get())
sys.stdin.readline()
print(events.get())
session.close()
"""
)

CLIENT = (
    NODE
    + """
inbox = queue.Queue()
listener = session.declare_subscriber(
    "nrs/r/orders/left", lambda s: inbox.put(s.payload.to_string()))
token = session.liveliness().declare_token("nrs/r/alive/left")
assert [r.ok.payload.to_bytes() for r in session.get("nrs/r/start/left")] == [b"go"]
for k in range(int(sys.argv[2])):
    session.put("nrs/r/samples/left", str(k), congestion_control=block)
print(json.dumps([inbox.get() for _ in range(int(sys.argv[2]))]))
sys.stdin.readline()
session.close()
"""
)

FLOOD = (
    ENDPOINTS
    + """
from threading import Thread
from nrs_cosim.bus.network.zenoh_bus import ZenohBus

bus = ZenohBus("r", endpoints)
print(bus.id)
mine, other = ("left", "right") if endpoints.listen else ("right", "left")
links, received = bus.listen(), bus.listen(other)
bus.watch_links(links)
put = bus.publisher(mine)

def flood():
    while True:
        put(bytes(10_000))

Thread(target=flood, daemon=True).start()
received.take(60.0)
print("received")
print(links.take(60.0)[0].peer)
sys.stdin.readline()
"""
)


def settings_of(tls=None, **endpoints):
    """Return what a node of the test is told: fields of its `Endpoints`."""
    return json.dumps({**endpoints, "tls": tls and [str(path) for path in asdict(tls).values()]})


WHOLE, POOR = {}, {"delay_ms": 5, "loss_percent": 2}


WIRES = [("tls", POOR), ("tcp", WHOLE), ("tcp", POOR), ("tls", WHOLE)]


@pytest.mark.parametrize(("protocol", "quality"), cases(WIRES, WIRES[:1]))
def test_messages_cross_a_wire_and_a_cut_is_noticed(protocol, quality, tmp_path):
    with two_machines(**quality) as wire:
        authority, address = Authority(tmp_path), wire.left.address
        hub_tls = client_tls = None
        if protocol == "tls":
            hub_tls = authority.issue("orchestrator", address)
            client_tls = authority.issue("left", wire.right.address)
        meet = [f"{protocol}/{address}:{PORT}"]
        listen = settings_of(hub_tls, listen=meet, insecure_tcp=True, lease=LEASE)
        connect = settings_of(client_tls, connect=meet, insecure_tcp=True, lease=LEASE, wait=GUARD)
        with wire.left.python(HUB, listen) as hub:
            assert hub.stdout.readline() == "open\n"
            with wire.right.python(CLIENT, connect, str(MESSAGES)) as client:
                assert json.loads(client.stdout.readline()) == list(map(str, range(MESSAGES)))
                assert "PUT nrs/r/alive/left" in hub.stdout.readline()
                wire.cut()
                hub.stdin.write("\n")
                hub.stdin.flush()
                assert "DELETE nrs/r/alive/left" in hub.stdout.readline()
                wire.mend()
                client.communicate("\n", timeout=GUARD)
            hub.wait(timeout=GUARD)
        assert (hub.returncode, client.returncode) == (0, 0)


def test_a_cut_is_reported_to_blocked_senders(tmp_path):
    """Zenoh closes a link over TLS only when all that was put into it has left, or TCP gives up."""
    with two_machines() as wire:
        authority, meet = Authority(tmp_path), [f"tls/{wire.left.address}:{PORT}"]
        listen = settings_of(
            authority.issue("orchestrator", wire.left.address), listen=meet, lease=LEASE
        )
        client = authority.issue("left", wire.right.address)
        connect = settings_of(client, connect=meet, lease=LEASE, wait=GUARD)
        with wire.left.python(FLOOD, listen) as hub:
            assert hub.stdout.readline()
            with wire.right.python(FLOOD, connect) as client:
                id_ = client.stdout.readline()
                assert (hub.stdout.readline(), client.stdout.readline()) == ("received\n",) * 2
                wire.cut()
                assert client.stdout.readline() == "None\n"
                assert hub.stdout.readline() == id_
