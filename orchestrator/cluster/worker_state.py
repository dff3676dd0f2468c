"""The life of a worker slot: who has its robots, and how far that worker is.

        ┌───────── start ────────▶ STARTING ─── join ───┐
        │                                               ▼
     VACANT ──────────────────────── join ─────────▶ ADMITTED ◀──────── join ────────┐
        ▲                                               │ appear                     │
        │                                               ▼                            │
        ├──── lose (before it is done) ────          OPENING                         │
        │                                               │ open (also when ADMITTED)  │
        │                                               ▼                            │
        │                                             READY                          │
        │                                               │ begin                      │
        │                                               ▼                            │
        └──── lose ── FAILED ◀─── fail ───────────── RUNNING ── finish ──▶ DONE ── lose ──▶ AWAY

When the run is over (`end`), who is here is told so, and who may not know it is waited for:

     OPENING, READY, RUNNING, DONE, FAILED ── end ─▶ ENDING ── acknowledge ─▶ INFORMED
     VACANT, STARTING, ADMITTED ── end ─▶ LEFT       ENDING ── lose ─▶ UNAWARE
     AWAY ── end ─▶ UNAWARE                          INFORMED ── lose ─▶ LEFT
     ENDING, INFORMED, UNAWARE ── join, which is refused with the reason ─▶ LEFT

Nothing here talks, waits or reads a clock: events come with their times, s, and what has no place
in the table changes nothing. A worker that is done and gone is not missed: all that it had to say
was said, so its slot is AWAY and not VACANT.
"""

from dataclasses import dataclass
from enum import Enum, auto

APPEARING = 10.0
"""s: how long a worker that is let in may take to be present."""
STARTING_UP = 60.0
"""s: how long a process of this machine may take to ask to join the run that started it."""
MOST_DEATHS = 3
"""How often in a row a worker may die at one tick and be started again."""


class State(Enum):
    """How far a slot's worker is; see the module."""

    VACANT = auto()
    """There is none."""
    STARTING = auto()
    """A process of this machine was started, and has not asked to join."""
    ADMITTED = auto()
    """It was let in, and has not appeared on the bus."""
    OPENING = auto()
    """It opens its robots."""
    READY = auto()
    """Its robots are open; it waits to be told where to begin."""
    RUNNING = auto()
    DONE = auto()
    """It said all of its last tick."""
    FAILED = auto()
    """It said what it failed with."""
    AWAY = auto()
    """It was done, and its link was lost: it may come back to ask how the run ended."""
    ENDING = auto()
    """It is told that the run is over."""
    INFORMED = auto()
    """It said that it knows."""
    UNAWARE = auto()
    """The run is over, and its link was lost before it said that it knows."""
    LEFT = auto()
    """Nobody is waited for."""


class Event(Enum):
    """What happens to a slot."""

    START = auto()
    JOIN = auto()
    APPEAR = auto()
    OPEN = auto()
    BEGIN = auto()
    FINISH = auto()
    FAIL = auto()
    LOSE = auto()
    """Its presence, its link or its process ended."""
    END = auto()
    ACKNOWLEDGE = auto()


S, E = State, Event

WITHOUT_WORKER = frozenset({S.VACANT, S.STARTING, S.ADMITTED, S.OPENING})
"""Where the slot's robots do not move, nor are about to."""
UNOCCUPIED = frozenset({S.VACANT, S.STARTING, S.AWAY, S.UNAWARE, S.LEFT})
"""Where nobody is let in."""
WELL = frozenset({S.RUNNING, S.DONE, S.FAILED, S.AWAY})
"""Where the worker was told to begin, and was not lost before it was done."""

TRANSITIONS: dict[tuple[State, Event], State] = {
    (S.VACANT, E.START): S.STARTING,
    **{(state, E.JOIN): S.ADMITTED for state in (S.VACANT, S.STARTING, S.AWAY)},
    (S.ADMITTED, E.APPEAR): S.OPENING,
    # Its presence and its words come on ways of their own, in any order.
    **{(state, E.OPEN): S.READY for state in (S.ADMITTED, S.OPENING)},
    (S.READY, E.BEGIN): S.RUNNING,
    (S.RUNNING, E.FINISH): S.DONE,
    (S.RUNNING, E.FAIL): S.FAILED,
    **{
        (state, E.LOSE): S.VACANT
        for state in (S.STARTING, S.ADMITTED, S.OPENING, S.READY, S.RUNNING, S.FAILED)
    },
    (S.DONE, E.LOSE): S.AWAY,
    **{(state, E.END): S.LEFT for state in (S.VACANT, S.STARTING, S.ADMITTED)},
    **{(state, E.END): S.ENDING for state in (S.OPENING, S.READY, S.RUNNING, S.DONE, S.FAILED)},
    (S.AWAY, E.END): S.UNAWARE,
    (S.ENDING, E.ACKNOWLEDGE): S.INFORMED,
    (S.ENDING, E.LOSE): S.UNAWARE,
    (S.INFORMED, E.LOSE): S.LEFT,
    **{(state, E.JOIN): S.LEFT for state in (S.ENDING, S.INFORMED, S.UNAWARE)},
}


@dataclass(slots=True)
class WorkerState:
    """A slot's state, with what of its past is of use."""

    since: float
    """s: when a worker was started, let in, or lost."""
    state: State = State.VACANT
    incarnation: str | None = None
    """The id of the session of the worker that is let in; None while there is none."""
    deaths: int = 0
    """How many workers in a row were lost at the tick `died_at`, before they were done."""
    died_at: int | None = None
    recorded: int = -1
    """The last tick that was recorded when it began."""
    caught_up: int = -1
    """The last recorded tick whose samples it asked for to catch up."""

    def on(self, event: Event) -> bool:
        """Go where an event leads; return whether it has a place in this state."""
        following = TRANSITIONS.get((self.state, event))
        if following is None:
            return False
        self.state = following
        if following in UNOCCUPIED:
            self.incarnation = None
        return True

    def start(self, now: float) -> bool:
        """Know that a process was started for it."""
        return self._at(now) if self.on(Event.START) else False

    def join(self, incarnation: str, now: float) -> bool:
        """Let a worker in; or, when the run is over, know that one was told so instead."""
        if not self.on(Event.JOIN):
            return False
        if self.state is State.ADMITTED:
            self.incarnation = incarnation
        return self._at(now)

    def begin(self, recorded: int) -> bool:
        """Know that its worker was told to begin; the ticks up to `recorded` are recorded."""
        if not self.on(Event.BEGIN):
            return False
        self.recorded, self.caught_up = recorded, -1
        return True

    def lose(self, closed: int, now: float) -> bool:
        """Do without its worker from now on, after the tick that was closed last (−1: none)."""
        if not self.on(Event.LOSE):
            return False
        if self.state is State.VACANT:
            self.deaths = self.deaths + 1 if self.died_at == closed else 1
            self.died_at = closed
        return self._at(now)

    def catch_up(self, k: int, closed: int) -> bool:
        """Return whether its worker got on, as it asks for samples of tick k and later ones."""
        got_on = self.caught_up < k <= closed
        if got_on:
            self.caught_up = k
        return got_on

    def never_appeared(self, now: float) -> bool:
        """Return whether a worker that was let in has been waited for long enough."""
        return self.state is State.ADMITTED and now - self.since >= APPEARING

    def never_joined(self, now: float) -> bool:
        """Return whether a process that was started has been waited for long enough."""
        return self.state is State.STARTING and now - self.since >= STARTING_UP

    def _at(self, now: float) -> bool:
        self.since = now
        return True
