"""What is declared on a session is taken back before it is closed; Zenoh would keep its memory."""

from collections import Counter

import pytest

from nrs_cosim.bus.network import zenoh_bus
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.bus.network.zenoh_bus import ZenohBus

KINDS = {
    "publisher",
    "subscriber",
    "queryable",
    "token",
    "link_events_listener",
}


class Watched:
    """Something of Zenoh's, of which each `declare_…` and `undeclare` is counted."""

    def __init__(self, whole, kind, counts):
        self._whole, self._kind, self._counts = whole, kind, counts

    def __getattr__(self, name):
        found = getattr(self._whole, name)
        if name == "undeclare":
            return lambda: (self._counts.subtract([self._kind]), found())
        if not callable(found):
            return Watched(found, name, self._counts) if name == "info" else found

        def called(*arguments, **options):
            made = found(*arguments, **options)
            if name == "liveliness":
                return Watched(made, name, self._counts)
            if not name.startswith("declare_"):
                return made
            kind = name.removeprefix("declare_")
            self._counts[kind] += 1
            return Watched(made, kind, self._counts)

        return called


@pytest.fixture
def counts(monkeypatch):
    """Return how many of each kind are declared and not taken back."""
    found = Counter()
    monkeypatch.setattr(
        zenoh_bus, "open_session", lambda ends: Watched(open_session(ends), "session", found)
    )
    return found


@pytest.mark.parametrize("listens", [False, True])
def test_closing_undeclares_everything_that_was_declared(counts, tmp_path, listens):
    listen = (f"unixsock-stream/{tmp_path}/s",) if listens else ()
    bus = ZenohBus("run", Endpoints(listen=listen))
    inbox = bus.listen("samples/*", "orders/*")
    bus.listen_to_all()
    for key in ("samples/a", "samples/b", "samples/a"):
        bus.publisher(key)(b"x")
    assert bus.wait_for_listener("samples/c", 5.0)
    bus.serve("join/*", inbox)
    bus.watch("alive/*", inbox)
    bus.watch_links(inbox)
    bus.announce("alive/a")
    assert {kind for kind, count in counts.items() if count} == KINDS
    assert counts["publisher"] == 2  # that of the wait is gone with it
    assert counts.pop("matching_listener") == 0  # there was one, as long as its wait
    bus.close()
    assert {kind: count for kind, count in counts.items() if count} == {}
