"""What a stranger puts is dropped before it fills the memory, counted, and changes nothing."""

import subprocess
import sys
from json import dumps
from pathlib import Path

import pytest
import zenoh

from benchmarks.memory import peak
from nrs_cosim.bus.network.endpoints import Endpoints, zenoh_settings
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Message, Rejected
from nrs_cosim.orchestrator.cluster.launcher import screen_of
from nrs_cosim.orchestrator.scenario.file import read_scenario
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cluster.remote_workers import PROCESS, Worker, alone, paper_file
from tests.guard import GUARD
from tests.network.ports import free_port

BLOCK = zenoh.CongestionControl.BLOCK
MB = 10**6


def test_unsigned_messages_are_not_kept_and_signed_ones_are(tmp_path):
    meet = f"unixsock-stream/{tmp_path}/s"
    signer = Signer(b"s" * 32)
    hub = ZenohBus("run", Endpoints(listen=(meet,)))
    inbox = hub.listen_to_all(screen_of(signer))
    for kind in ("join", "missed"):
        hub.serve(f"{kind}/*", inbox)
    with open_session(Endpoints(connect=(meet,))) as stranger:
        next(stranger.get("nrs/none", timeout=GUARD), None)  # by then it is declared
        replies = [
            stranger.get(f"nrs/run/{key}", payload=payload, timeout=GUARD)
            for key, payload in (("missed/a", b"x" * MB), ("join/a", b"x" * (2**20 + 1)))
        ]
        for key in ("run/samples/a", "run/records/a", "run/report/a", "other/samples/a"):
            for payload in (b"x" * MB, b"", Signer(b"guessed").sign("samples/a", b"x")):
                stranger.put(f"nrs/{key}", payload, congestion_control=BLOCK)
        last = signer.sign("samples/a", b"genuine")
        stranger.put("nrs/run/samples/a", last, congestion_control=BLOCK)
        items = []
        while Message("samples/a", last) not in items:
            items += inbox.take(GUARD)
        assert [list(each) for each in replies] == [[], []]
    hub.close()
    assert items[:-1] == [
        *(Rejected("missed"), Rejected("join")),
        *[Rejected("signature")] * 9,
        *[Rejected("key")] * 3,
    ]


def test_a_message_longer_than_any_batch_is_dropped(tmp_path):
    listen = Endpoints(listen=(f"unixsock-stream/{tmp_path}/s",))
    assert zenoh_settings(listen)["transport/link/rx/max_message_size"] == 256 * 2**20


FLOOD = """
import sys, zenoh
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session
meet, run = sys.argv[1:]
BLOCK = zenoh.CongestionControl.BLOCK
with open_session(Endpoints(connect=(meet,), insecure_tcp=True)) as session:
    next(session.get("nrs/none", timeout=180.0), None)
    for _ in range(12):
        session.put(f"nrs/{run}/samples/left", bytes(50_000_000), congestion_control=BLOCK)
    session.put("nrs/last", b"", congestion_control=BLOCK)
    next(session.get("nrs/none", timeout=180.0), None)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="the peak is told by Linux only")
def test_a_flood_of_600_megabytes_is_not_held_in_memory(nrs, tmp_path):
    path, meet = paper_file(tmp_path, 20), f"tcp/127.0.0.1:{free_port()}"
    result = {"file": str(path), "output": str(tmp_path / "x.mcap"), "listen": [meet]}
    run = nrs(dumps(result | {"pauses": [10]}), program=PROCESS)
    id_ = run.until("waits for workers").split()[1]
    worker = Worker(meet, "left")
    run.until("paused at tick 10")
    before = peak(run.process.pid)
    subprocess.run([sys.executable, "-c", FLOOD, meet, id_], check=True, timeout=GUARD)
    held = peak(run.process.pid) - before
    run.say()
    status, printed = run.end()
    worker.end()
    assert (status, "completed" in printed) == (0, True), printed
    assert held < 300 * MB, f"{held / MB:.0f} MB"
    with Reader(tmp_path / "x.mcap") as reader:
        assert reader.digest == alone(read_scenario(path), tmp_path)
