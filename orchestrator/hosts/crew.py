"""The hosts of a run that are processes of their own, here or elsewhere.

Every robot has a home, and a home has at most one host at a time. A host asks to be let in, opens
its robots, says that it is ready, and is told to begin when every home has one. A host whose link
or presence ends is gone: its home waits for another, which is told to begin where the recording
allows, while the rest of the run goes on as far as the data lets it.
"""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import monotonic
from typing import Any

from nrs_cosim.bus.errors import BusError, InputError, RunError
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
from nrs_cosim.bus.network.access import expect_host_name
from nrs_cosim.bus.network.zenoh_bus import ZenohBus, ZenohInbox
from nrs_cosim.bus.parts import joined
from nrs_cosim.bus.seal import Seal
from nrs_cosim.bus.text import storable
from nrs_cosim.bus.transport import Cut, Item, Message, Presence, Question, Rejected, Screen
from nrs_cosim.bus.wire import Wire
from nrs_cosim.orchestrator.errors import HostError
from nrs_cosim.orchestrator.hosts.homes import Home, Homes, NotLetInError
from nrs_cosim.orchestrator.hosts.local import STARTING, LocalHost
from nrs_cosim.orchestrator.hosts.notes import END, TICK, Go, Hello, Ready, Refusal, Report, Welcome
from nrs_cosim.orchestrator.runs.host import Spent
from nrs_cosim.orchestrator.runs.restart import AT_ONCE, point_of
from nrs_cosim.orchestrator.runs.robots import wire_of
from nrs_cosim.orchestrator.scenario.file import ScenarioFile
from nrs_cosim.orchestrator.scenario.numbers import named
from nrs_cosim.orchestrator.scenario.setting import clock_of
from nrs_cosim.recordings.recorder import Recorder

_MOST_DEATHS = 3
_LONGEST_HELLO = 2**20
"""Bytes of what a host says to be let in, which is the one thing that is not sealed."""
_ASKED = (START, HEARD, FMU)
_SEALED = (SAMPLES, RECORDS, REPORT, ORDERS, *_ASKED)
_COMING = 10.0
"""s: how long a host that is let in may take to be present."""
_LOOK = 0.25
"""s: how long nothing may come before it is looked whether the hosts are well."""
_FAREWELL = 5.0
"""s: how long to wait for hosts when all else is done: for their reports, then for their end."""
_GRACE = 2.0
"""s: how long hosts may take to end when they are told to."""


@dataclass(frozen=True, slots=True, eq=False)
class Terms:
    """How a run treats its hosts."""

    expected: int
    """How many there will be, when those that name no robots are to share them."""
    start: Callable[[str, Sequence[int]], LocalHost] | None
    """Starts a host on this machine; None when they come from elsewhere."""
    restart: bool
    """Whether the run goes on when one is gone."""
    wait: float
    """s: how long a robot may be without a host."""
    show: Callable[[str], None]
    """Is told in words who comes and goes."""


def screen_of(seal: Seal) -> Screen:
    """Return what keeps of all that comes only what is under a run's seal, and short questions."""

    def screen(key: str, payload: bytes) -> str | None:
        kind = key.partition("/")[0]
        if kind == JOIN:
            return kind if len(payload) > _LONGEST_HELLO else None
        if kind not in _SEALED:
            return "key"
        if seal.opened(key, payload) is not None:
            return None
        return kind if kind in _ASKED else "seal"

    return screen


@dataclass(frozen=True, slots=True)
class Fmu:
    """An FMU of the scenario."""

    sha256: str
    content: Callable[[], bytes]


class Crew:
    """The hosts of a run; see `orchestrator.runs.lockstep.Hosts`."""

    def __init__(
        self,
        bus: ZenohBus,
        inbox: ZenohInbox,
        file: ScenarioFile,
        fmus: Mapping[str, Fmu],
        homes: Mapping[str, Sequence[int]],
        terms: Terms,
        secret: bytes,
    ) -> None:
        """Let hosts of a scenario in, from now on; `fmus` are by what the scenario calls them.

        `homes` are those whose hosts' names are known; further ones come about as hosts ask.
        """
        self.inbox = inbox
        self.refused: Counter[str] = Counter()
        self.restarts = 0
        self.asked: Counter[str] = Counter()
        """How often hosts asked for samples: to catch up, or because they were late."""
        self._homes = Homes(file.scenario.n, terms.expected)
        self._bus, self._file, self._fmus, self._terms = bus, file, fmus, terms
        self._secret, self._seal = secret, Seal(secret)
        self._recorder: Recorder | None = None
        self._began = monotonic()
        self._progress = False
        """Whether a host got on in what is recorded already, since that was last asked."""
        for kind in (JOIN, START, HEARD, FMU):
            bus.serve(wire_key(kind, "*"), inbox)
        bus.watch(wire_key(ALIVE, "*/*"), inbox)
        bus.watch_links(inbox)
        bus.announce(wire_key(ALIVE, ORCHESTRATOR))
        for name, robots in homes.items():
            self._homes[name] = Home(robots, reserved=True)

    @property
    def homes(self) -> dict[str, Sequence[int]]:
        """Return which robots each host has."""
        return {name: home.robots for name, home in self._homes.items()}

    def gather(self) -> None:
        """Start the hosts of this machine, and wait until every robot has a host that is ready.

        Raises the `InputError` of a host of this machine, and `RunError` when some do not come.
        """
        if self._terms.start:
            for name, home in self._homes.items():
                home.process, home.since = self._terms.start(name, home.robots), monotonic()
        else:
            self._terms.show(f"run {self._bus.run_id} waits for hosts{self._homes.missing()}")
        while self._homes.free or not all(home.begin for home in self._homes.values()):
            for item in self.inbox.take(_LOOK):
                self.handle(item)
            self.look_after(0)

    def wire(self) -> Wire:
        """Return the wire between the hosts that were gathered."""
        return wire_of(self._file.scenario, self.homes, self._seal)

    def told(self) -> list[dict[str, Any]]:
        """Return what the user is told of the plants, by group, whatever host they are on."""
        return self._homes.told()

    def begin(self, recorder: Recorder) -> None:
        """Tell all hosts to begin where a recording ends."""
        self._recorder = recorder
        for home in self._homes.values():
            self._send_off(home)

    def advance(self, k: int) -> None:
        """Do nothing: hosts advance by themselves."""

    def handle(self, item: Item) -> None:
        """Take what came and is neither samples nor records."""
        if isinstance(item, Question):
            kind, _, name = item.key.partition("/")
            answers = {
                JOIN: self._join,
                START: self._start,
                HEARD: self._tell_heard,
                FMU: self._hand_out,
            }
            if kind in answers:
                answers[kind](name, item)
            else:
                self.refused["question"] += 1
        elif isinstance(item, Presence):
            name, _, incarnation = item.key.partition("/")[2].partition("/")
            home = self._homes.get(name)
            if home and home.incarnation == incarnation:
                home.present = item.here
                if not item.here:
                    self._lose(name, home)
        elif isinstance(item, Cut):
            for name, home in list(self._homes.items()):
                if home.incarnation is not None and item.peer in {None, home.incarnation}:
                    self._lose(name, home)
        elif isinstance(item, Message):
            self._read_report(item)
        elif isinstance(item, Rejected):
            self.refused[item.why] += 1

    def look_after(self, k: int, at_last: bool = False) -> bool:
        """Look whether the hosts are well; return whether all are there and none is catching up.

        Raises what a host failed with at tick k or before, and `RunError` when a robot has been
        without a host for too long; see `orchestrator.runs.lockstep.Hosts`.
        """
        for name, home in list(self._homes.items()):
            never_came = home.incarnation and not home.present and home.seconds >= _COMING
            if never_came or (home.process and home.process.ending() is not None):
                self._lose(name, home)
        self._fail(k, at_last)
        homeless = dict(self._homes.homeless()) | dict.fromkeys(self._homes.free, self._began)
        if homeless and monotonic() - min(homeless.values()) >= self._terms.wait:
            who = named(sorted(homeless))
            raise HostError(
                f"{who} had no host for {self._terms.wait:g} s: no `nrs host` came for them; "
                "--wait gives them longer"
            )
        for name, home in self._homes.items():
            if home.process and home.incarnation is None and home.seconds >= STARTING:
                raise HostError(
                    f"host {name} ({named(home.robots)}), a process of this machine, did not ask "
                    f"to join within {STARTING:g} s of its start{home.process.last_words()}"
                )
            # One that waits for the others to be gathered is ready too.
            is_there = home.is_ready or home.begin
            if home.process and not is_there and home.seconds >= self._terms.wait:
                raise HostError(
                    f"host {name} ({named(home.robots)}) was not ready within "
                    f"{self._terms.wait:g} s of its start; --wait gives it longer"
                )
        progress, self._progress = self._progress, False
        return not progress and all(home.is_ready for home in self._homes.values())

    def spent(self) -> dict[str, Spent]:
        """Return where the time of each host went, as far as it said so."""
        return {
            name: Spent(home.report.plants, home.report.bus, home.report.waiting)
            for name, home in self._homes.items()
            if home.report
        }

    def end(self) -> None:
        """Let all hosts end, and hear how it was."""
        done = self._recorder and self._recorder.closed == clock_of(self._file.scenario).ticks
        homes = self._homes.values()
        if done:
            self._hear_out(lambda: all(home.report or not home.present for home in homes))
        for name in self._homes:
            key = wire_key(ORDERS, name)
            self._bus.publisher(key)(self._seal.closed(key, END))
        away = [home for home in homes if not home.process]
        self._hear_out(lambda: not any(home.present or home.is_away for home in away))
        until = monotonic() + _GRACE
        for home in homes:
            if home.process:
                home.process.wait(max(until - monotonic(), 0.0) if home.is_ready else 0.0)

    def _hear_out(self, is_enough: Callable[[], bool]) -> None:
        """Hear how hosts end, and tell those that come back that the run is over."""
        until = monotonic() + _FAREWELL
        while not is_enough() and monotonic() < until:
            for item in self.inbox.take(_LOOK):
                if isinstance(item, Message | Rejected):
                    self.handle(item)
                for name, home in self._homes.items():
                    present = wire_key(ALIVE, f"{name}/{home.incarnation}")
                    cut = isinstance(item, Cut) and item.peer in {None, home.incarnation}
                    if home.present and (cut or item == Presence(present, here=False)):
                        home.present, home.is_away = False, not home.knows
                    elif isinstance(item, Question) and item.key == wire_key(JOIN, name):
                        over = Refusal(reason="the run is over", final=True, over=True)
                        item.answer(over.written())
                        home.is_away = False

    def close(self) -> None:
        """Kill what still runs on this machine."""
        for home in self._homes.values():
            if home.process:
                home.process.kill()

    def _join(self, name: str, question: Question) -> None:
        # A run without hosts has nothing to encrypt, and need not wait for what does it.
        from nrs_cosim.bus.encryption import encrypt, expect_public_key  # noqa: PLC0415

        try:
            expect_host_name(name, "--name")
            hello: Hello = Hello.read(question.payload)
            expect_public_key(hello.public)
            home = self._homes.get(name)
            if home and home.incarnation == hello.incarnation:
                self._repeat(home, question)
                return
            home = self._homes.place(name, hello)
        except (BusError, InputError, NotLetInError) as error:
            final = not isinstance(error, NotLetInError) or error.final
            question.answer(Refusal(reason=str(error), final=final).written())
            return
        home.admit(hello.incarnation)
        if not home.process:
            missing = self._homes.missing()
            self._terms.show(f"{name} has joined with {named(home.robots)}{missing}")
        file = self._file
        welcome = Welcome(
            run=self._bus.run_id,
            secret=self._secret,
            name=file.name,
            scenario=file.text,
            folder=storable(str(file.folder.absolute())) if home.process else None,
            fmus={fmu: about.sha256 for fmu, about in self._fmus.items()},
            robots=tuple(home.robots),
        )
        where = f"{self._bus.run_id}/{question.key}"
        home.hello = question.payload
        home.welcome = encrypt(hello.public, where, welcome.written())
        question.answer(home.welcome)

    def _repeat(self, home: Home, question: Question) -> None:
        """Answer a host that asks again, as one does whose answer was lost, with the same bytes.

        An incarnation is public: one that asks in other words is a stranger, and is not answered;
        nor is anyone once the host is ready.
        """
        if question.payload == home.hello and not (home.begin or home.is_ready):
            question.answer(home.welcome)
        else:
            self.refused[JOIN] += 1

    def _start(self, name: str, question: Question) -> None:
        home, data = self._homes.get(name), self._seal.opened(question.key, question.payload)
        try:
            ready: Ready = Ready.read(data or b"")
        except BusError:
            home = None
        if home is None or home.incarnation != ready.incarnation or home.begin or home.is_ready:
            self.refused[START] += 1
            return
        robots = sorted(robot for told in ready.plants for robot in told.robots)
        if robots != [*home.robots] or not all(told.robots for told in ready.plants):
            self.refused[START] += 1
            return
        key = f"{question.key}/{ready.incarnation}"
        home.plants = [told.model_dump() | {"robots": [*told.robots]} for told in ready.plants]
        home.begin, home.report = lambda go: question.answer(self._seal.closed(key, go)), None
        if self._recorder is not None:
            self._send_off(home)

    def _send_off(self, home: Home) -> None:
        """Tell a host that is ready where to begin."""
        recorder = self._recorder
        if recorder is None or home.begin is None:
            return
        point = point_of(home.robots, recorder.checkpoints, recorder.closed)
        homes = {name: tuple(each.robots) for name, each in self._homes.items()}
        go = Go(homes=homes, start=point.start, recorded=point.recorded)
        home.begin(go.with_checkpoints(point.checkpoints))
        home.begin, home.is_ready = None, True
        home.recorded, home.caught_up = point.recorded, -1

    def _tell_heard(self, name: str, question: Question) -> None:
        """Answer with the samples of the next ticks that are known."""
        recorder, home = self._recorder, self._homes.get(name)
        data = self._seal.opened(question.key, question.payload)
        if home is None or recorder is None or data is None or len(data) != TICK.size:
            self.refused[HEARD] += 1
            return
        (since,) = TICK.unpack(data)
        if home.caught_up < since <= recorder.closed:
            home.caught_up, self._progress = since, True
        self.asked["late" if since > home.recorded + 1 else "to catch up"] += 1
        known = recorder.samples(since, since + AT_ONCE - 1)
        parts = (
            part
            for k, records, host in known
            for part in (TICK.pack(k), records.tobytes(), host.encode())
        )
        question.answer(self._seal.closed(f"{question.key}/answer", joined(parts)))

    def _hand_out(self, sha256: str, question: Question) -> None:
        found = [fmu for fmu in self._fmus.values() if fmu.sha256 == sha256]
        if not found or self._seal.opened(question.key, question.payload) is None:
            self.refused[FMU] += 1
            return
        try:
            content = found[0].content()
        except OSError as error:
            self._terms.show(f"an FMU that a host asks for cannot be read: {error}")
            question.answer(b"")
        else:
            question.answer(content)

    def _read_report(self, message: Message) -> None:
        kind, _, name = message.key.partition("/")
        home = self._homes.get(name) if kind in (REPORT, ORDERS) else None
        if home is None:
            self.refused["key"] += 1
            return
        data = self._seal.opened(message.key, message.payload)
        if data is None:
            self.refused["seal"] += 1
            return
        if kind == ORDERS:  # one's own
            return
        if data == END:
            home.knows = True
            return
        try:
            report: Report = Report.read(data)
        except BusError:
            self.refused["form"] += 1
            return
        home.report = report
        if report.tick < 0 and report.failed:
            if home.process:
                raise (RunError if self._recorder else InputError)(report.failed)
            self._terms.show(f"{name} cannot open {named(home.robots)}: {report.failed}")

    def _fail(self, k: int, at_last: bool) -> None:
        """Raise what hosts failed with at tick k, or while they came there.

        When each host is there, or has failed, the first in the order of one process is known.
        """
        failed = {
            name: home.report
            for name, home in self._homes.items()
            if home.report and home.report.failed
            if (home.process or home.report.tick >= 0) and home.report.tick <= k
        }
        if not failed:
            return
        missing = self._recorder.missing(k) if self._recorder else {}
        came = SAMPLES if k else RECORDS
        if at_last or all(
            name in failed or came not in missing.get(name, ()) for name in self._homes
        ):
            first = min(failed.values(), key=lambda report: (report.tick, report.place))
            raise RunError(str(first.failed), first.cause)

    def _lose(self, name: str, home: Home) -> None:
        """Do without a host that is gone, or start it again."""
        if home.report and home.report.failed is None:
            home.incarnation, home.present, home.is_away = None, False, True
            return
        how = home.process.kill() if home.process else "is gone"
        home.admit(None)
        closed = self._recorder.closed if self._recorder else -1
        told = f"{name} ({named(home.robots)}) {how}, after tick {max(closed, 0)}"
        home.deaths = home.deaths + 1 if home.died_at == closed else 1
        home.died_at = closed
        if home.process and home.deaths > _MOST_DEATHS:
            raise HostError(f"host {told}, for the {home.deaths}th time in a row")
        if self._recorder is None:
            if not home.reserved:
                del self._homes[name]
        elif not self._terms.restart:
            raise HostError(f"host {told}")
        else:
            self.restarts += 1
        if home.process and self._terms.start:
            self._terms.show(f"{told}; it is started again")
            home.process, home.since = self._terms.start(name, home.robots), monotonic()
        else:
            self._terms.show(f"{told}; waiting for it to come back{self._homes.missing()}")
