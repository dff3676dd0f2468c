"""Every robot has a home, and a home has at most one host at a time."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from time import monotonic
from typing import Any

from nrs_cosim.bus.text import quoted
from nrs_cosim.bus.transport import Put
from nrs_cosim.orchestrator.hosts.local import LocalHost
from nrs_cosim.orchestrator.hosts.notes import Hello, Report
from nrs_cosim.orchestrator.scenario.numbers import named


class NotLetInError(Exception):
    """A host that cannot have the home that it asks for; `final` if asking again is of no use."""

    def __init__(self, reason: str, *, final: bool) -> None:
        super().__init__(reason)
        self.final = final


@dataclass(slots=True)
class Home:
    """Some robots, and the host that has them."""

    robots: Sequence[int]
    process: LocalHost | None = None
    """When the orchestrator starts it."""
    reserved: bool = False
    """For a host of this name, also when it does not come."""
    incarnation: str | None = None
    """The id of the session of the host that is let in; None while there is none."""
    hello: bytes = b""
    """What that host said to be let in, and says again where the answer was lost."""
    welcome: bytes = b""
    """The answer, which that host alone can read."""
    since: float = field(default_factory=monotonic)
    """When that changed."""
    present: bool = False
    is_away: bool = False
    """Whether its host was done and its link was lost: it does not know how the run ends."""
    knows: bool = False
    """Whether its host said that it has heard of the end."""
    plants: list[dict[str, Any]] = field(default_factory=list)
    begin: Put | None = None
    """Answers a host that is ready and waits for its beginning."""
    recorded: int = -1
    """The last tick that was recorded when it began."""
    is_ready: bool = False
    caught_up: int = -1
    """The last recorded tick whose samples it asked for to catch up."""
    deaths: int = 0
    """At the tick `died_at`."""
    died_at: int = -2
    report: Report | None = None

    @property
    def seconds(self) -> float:
        """How long ago a host was let in, or went."""
        return monotonic() - self.since

    def admit(self, incarnation: str | None) -> None:
        """Have another host from now on, which is not here yet; None for none."""
        self.incarnation, self.since, self.present = incarnation, monotonic(), False
        self.hello = self.welcome = b""
        self.begin, self.is_ready, self.is_away, self.knows = None, False, False, False


class Homes(dict[str, Home]):
    """The homes of n robots by the names of their hosts."""

    def __init__(self, n: int, expected: int) -> None:
        """Let so many hosts share the robots, of those that name none."""
        super().__init__()
        self._n, self._expected = n, expected
        self.free: Sequence[int] = range(1, n + 1)
        """The robots that have no home yet, ascending."""

    def __setitem__(self, name: str, home: Home) -> None:
        """Let a host have a home; its robots are free until then."""
        super().__setitem__(name, home)
        taken = {*home.robots}
        self.free = [robot for robot in self.free if robot not in taken]

    def __delitem__(self, name: str) -> None:
        """Let a host go for good; its robots are free again."""
        self.free = sorted([*self.free, *self[name].robots])
        super().__delitem__(name)

    def missing(self) -> str:
        """Say who is missing, as the end of a sentence; nothing when nobody is."""
        vacant = [f"host {name}" for name, home in self.items() if home.incarnation is None]
        missing = ([named(self.free)] if self.free else []) + vacant
        return f"; missing: {', '.join(missing)}" if missing else ""

    def homeless(self) -> Iterator[tuple[int, float]]:
        """Yield the robots whose host is to come from elsewhere, and since when it is not here."""
        for home in self.values():
            if not (home.is_ready or home.begin or home.process):
                yield from ((robot, home.since) for robot in home.robots)

    def place(self, name: str, hello: Hello) -> Home:
        """Return the home of a host that may have it; `NotLetInError` when it may not."""
        if hello.version != version("nrs-cosim"):
            raise NotLetInError(
                f"the run is of nrs-cosim {version('nrs-cosim')}, the host of {hello.version}: "
                "install the same",
                final=True,
            )
        home = self.get(name)
        if home is None:
            home = self._new(hello)
            self[name] = home
        elif home.incarnation is not None and not home.process:
            raise NotLetInError(f"there is a host of the name {quoted(name)} already", final=False)
        elif hello.robots is not None and tuple(home.robots) != hello.robots:
            raise NotLetInError(
                f"--robots: {quoted(name)} has {named(home.robots)} in this run, not "
                f"{named(hello.robots)}",
                final=True,
            )
        return home

    def _new(self, hello: Hello) -> Home:
        free = self.free
        if not free:
            vacant = [
                f"{name} ({named(home.robots)})"
                for name, home in self.items()
                if home.incarnation is None
            ]
            raise NotLetInError(
                "every robot has a home"
                + (f"; take the place of {' or '.join(vacant)} by --name" if vacant else ""),
                final=not vacant,
            )
        if hello.robots is None:
            left = max(self._expected - len(self), 1)
            return Home(free[: -(-len(free) // left)])
        if not hello.robots or not {*hello.robots} <= {*free}:
            raise NotLetInError(
                f"--robots: {named(free)} of {self._n} have no home yet, but "
                f"this host asks for {named(hello.robots) if hello.robots else 'none'}",
                final=True,
            )
        return Home(sorted({*hello.robots}))

    def told(self) -> list[dict[str, Any]]:
        """Return what the user is told of the plants, by group, whatever host they are on."""
        merged: dict[str, dict[str, Any]] = {}
        for home in self.values():
            for told in home.plants:
                alike = str({**told, "robots": None})
                merged.setdefault(alike, {**told, "robots": []})["robots"] += told["robots"]
        for told in merged.values():
            told["robots"].sort()
        return sorted(merged.values(), key=lambda told: told["robots"][0])
