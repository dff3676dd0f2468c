"""The bus over a Zenoh session; by default one that opens no socket: nobody listens or scouts.

A put reaches the session's own subscribers before it returns (session-local delivery), so what
was put before `take` is in what `take` returns. On the wire `nrs/<run id>/` stands before every
key; the code sees it only where a message of another run is to be told apart.
"""

from collections.abc import Callable
from contextlib import suppress
from queue import Empty, SimpleQueue
from typing import Any, Protocol

import zenoh
from zenoh.handlers import Callback

from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.matching import wait_for_match
from nrs_cosim.bus.network.sessions import open_session
from nrs_cosim.bus.transport import (
    Answer,
    Cut,
    Item,
    Message,
    Presence,
    Put,
    Question,
    Rejected,
    Screen,
)

ROOT = "nrs"
NO_SOCKET = Endpoints()
_NOBODY = 3600.0
"""s: how long a question waits for its answer; who asks decides how long to look for it."""


class ZenohInbox:
    """A party's inbox; a C callable fills it, and no Python runs in Zenoh's threads.

    With a screen Python does: what would be rejected is dropped there and counted, before any
    number of such messages fills the memory; a `Rejected` of a few bytes stands for each.
    """

    def __init__(self, prefix: str, screen: Screen | None = None) -> None:
        self._prefix = prefix
        self.waiting: SimpleQueue[Any] = SimpleQueue()
        self.put = self._screened(screen) if screen else self.waiting.put

    def take(self, seconds: float = 0.0) -> list[Item]:
        """Return all that arrived, in order; wait for the first at most for so many seconds."""
        queue = self.waiting
        try:
            first = queue.get(timeout=seconds) if seconds else queue.get_nowait()
        except Empty:
            return []
        # What arrives meanwhile is for the next time, so that this comes to an end.
        return [self._item(first), *(self._item(queue.get()) for _ in range(queue.qsize()))]

    def _screened(self, screen: Screen) -> Callable[[Any], None]:
        put, key_of = self.waiting.put, self._key

        def screened(raw: zenoh.Sample | zenoh.Query) -> None:
            payload = raw.payload.to_bytes() if raw.payload else b""
            why = screen(key_of(raw.key_expr), payload)
            if why is None:
                put(raw)
                return
            if isinstance(raw, zenoh.Query):
                raw.drop()  # type: ignore[no-untyped-call]
            put(Rejected(why))

        return screened

    def _item(self, raw: Any) -> Item:
        if isinstance(raw, zenoh.Sample):
            return Message(self._key(raw.key_expr), raw.payload.to_bytes())
        if isinstance(raw, zenoh.Query):
            return _question(raw, self._key(raw.key_expr))
        if isinstance(raw, Cut | Rejected):
            return raw
        kind, event, *replied = raw
        if kind is Presence:
            return Presence(self._key(event.key_expr), event.kind == zenoh.SampleKind.PUT)
        if not replied:
            return Answer(event, None)
        answered = replied[0].ok
        return Answer(event, answered.payload.to_bytes() if answered else b"")

    def _key(self, wire: zenoh.KeyExpr) -> str:
        """Return a key of the run's own; one of others, or a pattern of many runs, as it is."""
        return str(wire).removeprefix(self._prefix)


def _question(query: zenoh.Query, key: str) -> Question:
    def answer(payload: bytes) -> None:
        with suppress(zenoh.ZError):  # who asked is gone
            query.reply(query.key_expr, payload)
        query.drop()  # type: ignore[no-untyped-call]

    return Question(key, query.payload.to_bytes() if query.payload else b"", answer)


class _Declared(Protocol):
    def undeclare(self) -> None: ...


class ZenohBus:
    """A party's way to a Zenoh session, on the keys of one run."""

    def __init__(self, run_id: str, endpoints: Endpoints = NO_SOCKET) -> None:
        """Open a session; `InputError` and `BusError` as `open_session`."""
        self._session = open_session(endpoints)
        self._has_one_link = bool(endpoints.connect)
        self.run_id = run_id
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._declared: list[_Declared] = []
        """All that was declared on the session; it would keep the memory of what is not taken back.

        That is 13 KiB a publisher, with eclipse-zenoh 1.10.
        """

    @property
    def id(self) -> str:
        """The session's id, by which others know whose link is lost."""
        return str(self._session.zid())

    @property
    def _prefix(self) -> str:
        return f"{ROOT}/{self.run_id}/"

    def publisher(self, key: str, encoding: str = "") -> Put:
        """Declare the right to put on a key; reliable, and blocking rather than dropping.

        Each message says its encoding, if there is one: a media type, and a schema after `;`.

        A client puts only where it was told that somebody listens, and is told so some time after
        this: let a question and its answer lie between this and the first message.
        """
        wire = self._prefix + key
        if wire not in self._publishers:
            publisher = self._session.declare_publisher(
                wire,
                encoding=zenoh.Encoding(encoding) if encoding else None,
                congestion_control=zenoh.CongestionControl.BLOCK,
                reliability=zenoh.Reliability.RELIABLE,
            )
            self._publishers[wire] = publisher
            self._declared.append(publisher)
        return self._publishers[wire].put

    def wait_for_listener(self, key: str, seconds: float) -> bool:
        """Wait until somebody listens on a key, or on one that a pattern matches.

        Return whether that was in time.
        """
        return wait_for_match(self._session, self._prefix + key, seconds)

    def listen(self, *patterns: str, screen: Screen | None = None) -> ZenohInbox:
        """Hear every key that a pattern matches, from now on, in an inbox of its own."""
        return self._listen([self._prefix + pattern for pattern in patterns], screen)

    def listen_to_all(self, screen: Screen | None = None) -> ZenohInbox:
        """Hear every key of every run that comes by, from now on; those of others in full."""
        return self._listen([f"{ROOT}/**"], screen)

    def watch(self, pattern: str, inbox: ZenohInbox) -> None:
        """Let an inbox learn who is present on keys of a pattern, now and from now on."""
        put = inbox.waiting.put

        def on_sample(sample: zenoh.Sample) -> None:
            put((Presence, sample))

        subscriber = self._session.liveliness().declare_subscriber(
            self._prefix + pattern,
            Callback(on_sample, indirect=False),
            history=True,
        )
        self._declared.append(subscriber)

    def watch_links(self, inbox: ZenohInbox) -> None:
        """Let an inbox learn of each link that is lost, from now on.

        Whoever was beyond it is present until Zenoh has closed the link, which waits for what a
        sender had filled it with, on TLS until TCP gives up; this is told before.
        """
        put = inbox.waiting.put

        def on_link_event(event: zenoh.LinkEvent) -> None:
            if event.kind == zenoh.SampleKind.DELETE:
                put(Cut(None if self._has_one_link else str(event.link.zid)))

        listener = self._session.info.declare_link_events_listener(
            Callback(on_link_event, indirect=False)
        )
        self._declared.append(listener)

    def announce(self, key: str) -> None:
        """Be present on a key until the session is closed or its process is gone."""
        self._declared.append(self._session.liveliness().declare_token(self._prefix + key))

    def serve(self, pattern: str, inbox: ZenohInbox) -> None:
        """Let questions on keys of a pattern come into an inbox."""
        queryable = self._session.declare_queryable(
            self._prefix + pattern, Callback(inbox.put, indirect=False)
        )
        self._declared.append(queryable)

    def offer(self, key: str, payload: bytes) -> None:
        """Answer whoever asks on a key."""

        def answer(query: zenoh.Query) -> None:
            _question(query, key).answer(payload)

        queryable = self._session.declare_queryable(
            self._prefix + key, Callback(answer, indirect=False)
        )
        self._declared.append(queryable)

    def ask(self, key: str, payload: bytes, inbox: ZenohInbox) -> None:
        """Ask all who serve a key; an inbox gets the answers, and `Answer(key, None)` at last.

        Which key an answer itself names is of no matter: anyone may serve, and answer on a pattern.
        """
        put = inbox.waiting.put

        def answered(reply: zenoh.Reply) -> None:
            put((Answer, key, reply))

        self._session.get(
            self._prefix + key,
            Callback(answered, lambda: put((Answer, key)), indirect=False),
            # All answers of all who serve: a stranger's must not take the place of a true one.
            target=zenoh.QueryTarget.ALL,
            payload=payload,
            timeout=_NOBODY,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def look_for(self, key: str, inbox: ZenohInbox) -> None:
        """Look in which runs somebody is present on a key.

        An inbox gets a `Presence` with each full key, and `Answer(key, None)` at last.
        """
        put = inbox.waiting.put

        def found(reply: zenoh.Reply) -> None:
            if reply.ok:
                put((Presence, reply.ok))

        self._session.liveliness().get(
            f"{ROOT}/*/{key}",
            handler=Callback(found, lambda: put((Answer, key)), indirect=False),
            timeout=_NOBODY,
        )

    def close(self) -> None:
        """Take back all that was declared on the session, the last first, and close it."""
        # A listener goes before the publisher that it is of.
        while self._declared:
            with suppress(zenoh.ZError):  # the link is lost
                self._declared.pop().undeclare()
        self._publishers.clear()
        self._session.close()  # type: ignore[no-untyped-call]

    def _listen(self, keys: list[str], screen: Screen | None = None) -> ZenohInbox:
        inbox = ZenohInbox(self._prefix, screen)
        for key in keys:
            put = Callback(inbox.put, indirect=False)
            self._declared.append(self._session.declare_subscriber(key, put))
        return inbox
