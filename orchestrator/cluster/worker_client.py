"""The process of a worker: it joins a run, runs its robots in it, and leaves when the run ends.

It needs no scenario file: it is given the scenario, and knows FMUs by their content. When its link
or the orchestrator is gone, it forgets the run and asks to be let in again; what its robots did so
far is in the recording.
"""

import hashlib
from collections.abc import Callable, Collection, Iterable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path
from threading import Thread
from time import monotonic

from nrs_cosim.bus.encryption import KeyPair
from nrs_cosim.bus.errors import BusError, CosimError, InputError, RunError
from nrs_cosim.bus.keys import (
    ALIVE,
    FMU,
    HEARD,
    JOIN,
    ORCHESTRATOR,
    ORDERS,
    RECORDS,
    REPORT,
    SAMPLES,
    START,
    wire_key,
)
from nrs_cosim.bus.network.access import expect_worker_name
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.zenoh_bus import ZenohBus, ZenohInbox
from nrs_cosim.bus.parts import parted
from nrs_cosim.bus.seal import Seal
from nrs_cosim.bus.transport import Answer, Cut, Item, Message, Presence
from nrs_cosim.bus.wire import RefusedError, Wire
from nrs_cosim.orchestrator.cluster.protocol import (
    END,
    TICK,
    Go,
    Hello,
    Ready,
    Refusal,
    Report,
    Told,
    Welcome,
)
from nrs_cosim.orchestrator.runs.restart import AT_ONCE
from nrs_cosim.orchestrator.runs.robots import Robots, wire_of
from nrs_cosim.orchestrator.runs.worker import Heard
from nrs_cosim.orchestrator.scenario.file import parse_scenario
from nrs_cosim.orchestrator.scenario.numbers import named
from nrs_cosim.plant_fmu.archives.archive import Archive, find_archive
from nrs_cosim.plant_fmu.archives.store import keep_fmu, stored_fmu
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models
from nrs_cosim.plant_fmu.errors import FmuError

_AGAIN = 0.5
"""s: how long to wait before a run is asked again."""
_SILENCE = 1.0
"""s: after that long without a sample the orchestrator is asked for it."""


class AbandonedError(CosimError):
    """The orchestrator is gone; its text says so to a user."""


class EndedError(CosimError):
    """The run is over."""


@dataclass(frozen=True, slots=True)
class JoinOptions:
    """How a worker joins."""

    name: str
    robots: Sequence[int] | None
    """The ones that it wants, ascending; None for any that are free."""
    run: str | None
    """How the id of the run begins, when several can be joined."""
    wait: float
    """s: how long to look for a run, or for one that is gone to come back."""
    allow_fmus: bool
    """Whether FMUs of the orchestrator may be run."""
    stays: bool
    """Whether to join again when the orchestrator is gone."""
    show: Callable[[str], None]
    """Is told in words what happens."""
    is_own: bool = False
    """Whether the orchestrator is the one that started it: its paths are the user's own."""


def serve(options: JoinOptions, endpoints: Endpoints) -> None:
    """Join a run, run robots in it until it ends.

    Raises `RunError` when there is no run in time, or the worker is not let in; `InputError` when
    its robots cannot be opened.
    """
    expect_worker_name(options.name, "--name")
    while True:
        bus = ZenohBus("*", endpoints)
        close = bus.close
        try:
            with ExitStack() as stack:
                welcome = _join_run(bus, options, endpoints.tls is not None)
                _run_assigned(stack, bus, options, welcome)
        except EndedError:
            return
        except AbandonedError as error:
            if not options.stays:
                return
            close = Thread(target=bus.close).start  # a cut link is waited for, some 10 s
            options.show(f"{error}; looking for it again")
        finally:
            close()


def _join_run(bus: ZenohBus, options: JoinOptions, tls: bool) -> Welcome:
    """Look for a run, and ask to be let in until it does."""
    inbox = bus.listen()
    robots = None if options.robots is None else tuple(options.robots)
    own = KeyPair()
    hello = Hello(
        version=version("nrs-cosim"), incarnation=bus.id, robots=robots, public=own.public
    ).written()
    present, join = wire_key(ALIVE, ORCHESTRATOR), wire_key(JOIN, options.name)
    until = monotonic() + options.wait
    last = "no run was found that waits for workers"
    if tls:
        last += (
            f"; if there is one, its bus.tls.workers may lack a certificate named {options.name}"
        )
    if options.run is not None:
        last = f"no run was found whose id begins with {options.run}; --run is of another"
    items: Sequence[Item] = ()
    while monotonic() < until:
        if not items:
            runs: set[str] = set()
            bus.look_for(present, inbox)
        items = inbox.take(_AGAIN)
        for item in items:
            if isinstance(item, Presence):
                runs.add(item.key.split("/")[1])
            elif item == Answer(present, None):
                if run := _chosen_run(runs, options.run or ""):
                    bus.run_id = run
                    bus.ask(join, hello, inbox)
            elif isinstance(item, Answer) and item.payload:
                note = _welcome_or_refusal(own, f"{bus.run_id}/{join}", item.payload)
                if isinstance(note, Welcome) and note.run == bus.run_id:
                    return note
                if isinstance(note, Refusal):
                    last = _reason_to_wait(note)
    raise RunError(f"not let into a run within {options.wait:g} s: {last}")


def _reason_to_wait(refusal: Refusal) -> str:
    """Return why a worker is not let in now; raises where asking again is of no use."""
    if refusal.over:
        raise EndedError(refusal.reason)
    if refusal.final:
        kind = InputError if refusal.reason.startswith("--") else RunError
        raise kind(f"not let into the run: {refusal.reason}")
    return refusal.reason


def _chosen_run(runs: Collection[str], begin: str) -> str | None:
    """Return the run that was meant, if it is there; `RunError` when it might be several."""
    meant = sorted(run for run in runs if run.startswith(begin) and "*" not in run)
    if len(meant) > 1:
        raise RunError(f"--run: give one of the {len(meant)} runs here: {', '.join(meant)}")
    return meant[0] if meant else None


def _welcome_or_refusal(own: KeyPair, where: str, data: bytes) -> Welcome | Refusal | None:
    welcome = own.decrypt(where, data)
    with suppress(BusError):
        return Refusal.read(data) if welcome is None else Welcome.read(welcome)
    return None


def _run_assigned(stack: ExitStack, bus: ZenohBus, options: JoinOptions, welcome: Welcome) -> None:
    """Open the robots, and run them from where the orchestrator says, until it ends the run."""
    name, seal = options.name, Seal(welcome.secret)
    report_key = wire_key(REPORT, name)
    put_report = bus.publisher(report_key)

    def report(note: Report) -> None:
        put_report(seal.closed(report_key, note.written()))

    options.show(f"joined {welcome.name} with {named(welcome.robots)}")
    inbox = bus.listen(wire_key(SAMPLES, "*"), wire_key(ORDERS, name))
    for kind in (SAMPLES, RECORDS):
        bus.publisher(wire_key(kind, name))  # before it asks to begin: see there
    bus.watch(wire_key(ALIVE, ORCHESTRATOR), inbox)
    bus.watch_links(inbox)
    bus.announce(wire_key(ALIVE, f"{name}/{bus.id}"))
    listening = _Listening(bus, inbox, name, seal)
    try:
        own = welcome.folder if options.is_own else None
        folder = Path(own) if own else Path("/nonexistent")
        file = parse_scenario(welcome.scenario, welcome.name, folder, welcome.name)
        finder = _Finder(bus, options, welcome, folder, seal)
        robots = Robots.opened(stack, file, welcome.robots, finder.find)
    except InputError as error:
        report(Report(tick=-1, failed=str(error)))
        raise
    told = tuple(Told.model_validate(told) for told in robots.told)
    go, checkpoints = Go.and_checkpoints(
        listening.ask_to_begin(Ready(incarnation=bus.id, plants=told))
    )
    listening.wire = wire = wire_of(file, go.assignment, seal)
    listening.recorded = go.recorded
    worker = robots.worker(name, bus, inbox, wire)
    if go.start:
        worker.restore(go.start, checkpoints)
    k = go.start
    try:
        for k in worker.run(go.recorded, lambda _time: None, listening):  # noqa: B007
            pass
    except (AbandonedError, EndedError):
        raise
    except RunError as error:
        cause = replace(error.cause, tick=worker.now)
        report(Report(tick=worker.now, failed=str(error), place=worker.place, cause=cause))
    else:
        spent = worker.spent
        report(Report(tick=k, plants=spent.plants, bus=spent.bus, waiting=spent.waiting))
    listening.until_end()


class _Listening:
    """What a worker hears beside samples, and how it asks for those that it missed."""

    patience = _SILENCE

    def __init__(self, bus: ZenohBus, inbox: ZenohInbox, name: str, seal: Seal) -> None:
        self.wire: Wire
        self.recorded = -1
        self._bus, self._inbox, self._name, self._seal = bus, inbox, name, seal
        self._orders = wire_key(ORDERS, name)
        self._early: list[Item] = []
        self._asked_until = -1
        self._lacking = (-1, 0.0)

    def ask_to_begin(self, ready: Ready) -> bytes:
        """Return the answer to being ready; samples that come before it are kept."""
        key = wire_key(START, self._name)
        self._bus.ask(key, self._seal.closed(key, ready.written()), self._inbox)
        go: bytes | None = None
        while not go:
            for item in self._inbox.take(_SILENCE):
                if isinstance(item, Answer):
                    if item.payload is not None:
                        go = go or self._seal.opened(f"{key}/{ready.incarnation}", item.payload)
                    elif not go:
                        raise AbandonedError("the orchestrator does not know this worker any more")
                elif isinstance(item, Message) and not item.key.startswith(ORDERS):
                    self._early.append(item)
                else:
                    list(self.handle(item))
        return go

    def lack(self, k: int, missing: Sequence[str]) -> Iterable[Heard]:  # noqa: ARG002
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
        elif now - self._lacking[1] >= _SILENCE:
            self._ask(k)
            self._lacking = k, now
        for item in early:
            if isinstance(item, Message):
                worker = item.key.rpartition("/")[2]
                with suppress(RefusedError):
                    yield (*self.wire.unpack_samples(worker, item.payload), worker)

    def handle(self, item: Item) -> Iterable[Heard]:
        """Take an answer or an order; `AbandonedError` and `EndedError` end the worker's part."""
        if isinstance(item, Cut) or item == Presence(wire_key(ALIVE, ORCHESTRATOR), here=False):
            raise AbandonedError("the orchestrator is gone")
        if isinstance(item, Message):
            if item.key == self._orders and self._seal.opened(item.key, item.payload) == END:
                key = wire_key(REPORT, self._name)
                self._bus.publisher(key)(self._seal.closed(key, END))
                raise EndedError("the run is over")
        elif isinstance(item, Answer) and item.payload:
            key = f"{wire_key(HEARD, self._name)}/answer"
            parts = parted(self._seal.opened(key, item.payload) or b"") or []
            for k, records, worker in zip(parts[::3], parts[1::3], parts[2::3], strict=True):
                yield TICK.unpack(k)[0], self.wire.samples.parsed(records), worker.decode()

    def until_end(self) -> None:
        """Wait until the run is over; raises as `handle`."""
        while True:
            for item in self._inbox.take(_SILENCE):
                if not isinstance(item, Message) or item.key.startswith(ORDERS):
                    list(self.handle(item))

    def _ask(self, k: int) -> None:
        key = wire_key(HEARD, self._name)
        self._bus.ask(key, self._seal.closed(key, TICK.pack(k)), self._inbox)
        self._asked_until = k + AT_ONCE - 1


class _Finder:
    """Finds the FMUs of a run on a worker, by content."""

    def __init__(
        self, bus: ZenohBus, options: JoinOptions, welcome: Welcome, folder: Path, seal: Seal
    ) -> None:
        self._bus, self._options, self._welcome, self._folder = bus, options, welcome, folder
        self._seal = seal

    def find(self, fmu: str) -> Archive:
        """Return the FMU that the scenario calls so, as the orchestrator has it.

        A bundled model is built. Any other is looked for in the cache; and, if the user allowed
        FMUs of the orchestrator, where the scenario says, then with the orchestrator. `FmuError`
        when it is not there.
        """
        sha256 = self._welcome.fmus.get(fmu, "")
        if fmu in bundled_models() or self._options.allow_fmus or self._options.is_own:
            with suppress(FmuError):
                archive = find_archive(fmu, self._folder)
                if archive.sha256 == sha256:
                    return archive
        path = stored_fmu(sha256) or self._fetched(fmu, sha256)
        return replace(find_archive(str(path), Path()), label=fmu)

    def _fetched(self, fmu: str, sha256: str) -> Path:
        if self._options.is_own:
            raise FmuError(f"{fmu}: is gone, or is no more what it was when the run began")
        if not self._options.allow_fmus:
            raise FmuError(
                f"{fmu}: this worker has no FMU of SHA-256 {sha256[:16]}… in its cache; "
                "--allow-fmus lets it run the orchestrator's, and those at paths that the scenario "
                "names"
            )
        inbox, key = self._bus.listen(), wire_key(FMU, sha256)
        self._bus.ask(key, self._seal.closed(key, b""), inbox)
        while True:
            for item in inbox.take(_SILENCE):
                if isinstance(item, Answer):
                    if item.payload is None:
                        raise AbandonedError("the orchestrator is gone")
                    if not item.payload:
                        raise FmuError(f"{fmu}: the orchestrator cannot read it any more")
                    if hashlib.sha256(item.payload).hexdigest() == sha256:
                        return keep_fmu(item.payload, sha256)
