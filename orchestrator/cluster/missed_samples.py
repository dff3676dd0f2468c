"""What a worker learns of the orchestrator: where to begin, samples that it missed, and the end."""

from collections.abc import Iterable, Sequence
from contextlib import suppress
from time import monotonic

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.bus.framing import parted
from nrs_cosim.bus.keys import ALIVE, MISSED, ORCHESTRATOR, ORDERS, REPORT, START, wire_key
from nrs_cosim.bus.network.zenoh_bus import ZenohBus, ZenohInbox
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.transport import Answer, Cut, Item, Message, Presence
from nrs_cosim.bus.validation import RejectedError, Wire
from nrs_cosim.orchestrator.cluster.protocol import END, TICK, Ready
from nrs_cosim.orchestrator.engine.restart import AT_ONCE
from nrs_cosim.orchestrator.engine.worker import ReceivedSamples

SILENCE = 1.0
"""s: after that long without a sample the orchestrator is asked for it."""


class AbandonedError(CosimError):
    """The orchestrator is gone; its text says so to a user."""


class EndedError(CosimError):
    """The run is over."""


class MissedSamples:
    """What a worker receives beside samples, and how it asks for those that it missed."""

    patience = SILENCE

    def __init__(self, bus: ZenohBus, inbox: ZenohInbox, name: str, signer: Signer) -> None:
        self.wire: Wire
        self.recorded = -1
        self._bus, self._inbox, self._name, self._signer = bus, inbox, name, signer
        self._orders = wire_key(ORDERS, name)
        self._early: list[Item] = []
        self._asked_until = -1
        self._lacking = (-1, 0.0)

    def ask_to_begin(self, ready: Ready) -> bytes:
        """Return the answer to being ready; samples that come before it are kept."""
        key = wire_key(START, self._name)
        self._bus.ask(key, self._signer.sign(key, ready.written()), self._inbox)
        go: bytes | None = None
        while not go:
            for item in self._inbox.take(SILENCE):
                if isinstance(item, Answer):
                    if item.payload is not None:
                        go = go or self._signer.verify(f"{key}/{ready.incarnation}", item.payload)
                    elif not go:
                        raise AbandonedError("the orchestrator does not know this worker any more")
                elif isinstance(item, Message) and not item.key.startswith(ORDERS):
                    self._early.append(item)
                else:
                    list(self.handle(item))
        return go

    def lack(self, k: int, missing: Sequence[str]) -> Iterable[ReceivedSamples]:  # noqa: ARG002
        """Return samples that came early; ask for others when they will not come by themselves.

        That is when the recording has them, or when they are late: then they may have been lost
        with a link, and the orchestrator has what reached it.
        """
        early, self._early = self._early, []
        now = monotonic()
        if k <= self.recorded + 1:
            if k > self._asked_until:
                self._ask(k)
        elif k != self._lacking[0]:
            self._lacking = k, now
        elif now - self._lacking[1] >= SILENCE:
            self._ask(k)
            self._lacking = k, now
        for item in early:
            if isinstance(item, Message):
                worker = item.key.rpartition("/")[2]
                with suppress(RejectedError):
                    yield (*self.wire.unpack_samples(worker, item.payload), worker)

    def handle(self, item: Item) -> Iterable[ReceivedSamples]:
        """Take an answer or an order; `AbandonedError` and `EndedError` end the worker's part."""
        if isinstance(item, Cut) or item == Presence(wire_key(ALIVE, ORCHESTRATOR), here=False):
            raise AbandonedError("the orchestrator is gone")
        if isinstance(item, Message):
            if item.key == self._orders and self._signer.verify(item.key, item.payload) == END:
                key = wire_key(REPORT, self._name)
                self._bus.publisher(key)(self._signer.sign(key, END))
                raise EndedError("the run is over")
        elif isinstance(item, Answer) and item.payload:
            key = f"{wire_key(MISSED, self._name)}/answer"
            parts = parted(self._signer.verify(key, item.payload) or b"") or []
            for k, records, worker in zip(parts[::3], parts[1::3], parts[2::3], strict=True):
                yield TICK.unpack(k)[0], self.wire.samples.parsed(records), worker.decode()

    def until_end(self) -> None:
        """Wait until the run is over; raises as `handle`."""
        while True:
            for item in self._inbox.take(SILENCE):
                if not isinstance(item, Message) or item.key.startswith(ORDERS):
                    list(self.handle(item))

    def _ask(self, k: int) -> None:
        key = wire_key(MISSED, self._name)
        self._bus.ask(key, self._signer.sign(key, TICK.pack(k)), self._inbox)
        self._asked_until = k + AT_ONCE - 1
