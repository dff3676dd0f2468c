"""One test class for both buses; and what Zenoh's must not do: open a socket."""

import os
from pathlib import Path

import pytest

from nrs_cosim.bus.memory_bus import MemoryBus
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.transport import tee


@pytest.fixture(params=[MemoryBus, lambda: ZenohBus("test-run")], ids=["memory", "zenoh"])
def bus(request):
    opened = request.param()
    yield opened
    opened.close()


class TestBus:
    def test_every_listener_receives_in_order(self, bus):
        first, second = bus.listen("sample/*"), bus.listen("*/*")
        one, two = bus.publisher("sample/1"), bus.publisher("sample/2")
        for payload in (b"a", b"b", b"c"):
            one(payload)
            two(payload.upper())
        story = [(f"sample/{node}", p) for a in "abc" for node, p in ((1, a), (2, a.upper()))]
        expected = [(key, payload.encode()) for key, payload in story]
        assert first.take() == expected
        assert second.take() == expected

    def test_only_matching_keys_are_received(self, bus):
        samples, one = bus.listen("sample/*"), bus.listen("state/1")
        for key in ("sample/1", "state/1", "state/11", "sample/1/more"):
            bus.publisher(key)(key.encode())
        assert samples.take() == [("sample/1", b"sample/1")]
        assert one.take() == [("state/1", b"state/1")]

    def test_of_a_shared_inbox_each_party_gets_all_in_order(self, bus):
        one, other = tee(bus.listen("sample/*"))
        put = bus.publisher("sample/1")
        put(b"a")
        assert one.take() == [("sample/1", b"a")]
        put(b"b")
        assert other.take() == [("sample/1", b"a"), ("sample/1", b"b")]
        put(b"c")
        assert one.take(1.0) == [("sample/1", b"b"), ("sample/1", b"c")]
        assert other.take(1.0) == [("sample/1", b"c")]
        assert one.take() == other.take() == []

    def test_a_taken_message_is_not_taken_again(self, bus):
        inbox, put = bus.listen("state/1"), bus.publisher("state/1")
        put(b"x")
        assert inbox.take() == [("state/1", b"x")]
        assert inbox.take() == []

    def test_messages_sent_before_listening_are_not_received(self, bus):
        put = bus.publisher("state/1")
        put(b"early")
        inbox = bus.listen("state/1")
        put(b"late")
        assert inbox.take() == [("state/1", b"late")]

    def test_empty_and_large_payloads_arrive_whole(self, bus):
        inbox, put = bus.listen("state/1"), bus.publisher("state/1")
        large = os.urandom(1 << 20)
        put(b"")
        put(large)
        assert [payload for _, payload in inbox.take()] == [b"", large]


def internet_sockets() -> set[str]:
    """Return the inodes of this process's own TCP and UDP sockets."""
    tables = [Path(f"/proc/self/net/{table}") for table in ("tcp", "tcp6", "udp", "udp6")]
    listed = {
        line.split()[9]
        for table in tables
        if table.exists()
        for line in table.read_text().splitlines()[1:]
    }
    own = set()
    for descriptor in Path("/proc/self/fd").iterdir():
        try:
            own.add(str(descriptor.readlink()))
        except FileNotFoundError:  # the descriptor that lists the folder itself
            continue
    return {inode for inode in listed if f"socket:[{inode}]" in own}


@pytest.mark.skipif(not Path("/proc/self/net").exists(), reason="sockets are listed by Linux only")
def test_zenoh_opens_no_socket():
    before = internet_sockets()
    bus = ZenohBus("no-socket")
    inbox = bus.listen("*/*")
    bus.publisher("sample/1")(b"x")
    assert inbox.take() == [("sample/1", b"x")]
    assert internet_sockets() == before
    bus.close()


def test_runs_in_one_process_do_not_receive_each_others_messages():
    one, other = ZenohBus("run-1"), ZenohBus("run-2")
    inbox = other.listen("**")
    one.publisher("sample/1")(b"x")
    assert inbox.take() == []
    one.close()
    other.close()
