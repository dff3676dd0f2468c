"""The life of a worker slot, event by event and in random orders; nothing is started or sent."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nrs_cosim.orchestrator.cluster import worker_state
from nrs_cosim.orchestrator.cluster.worker_state import (
    APPEARING,
    STARTING_UP,
    TRANSITIONS,
    UNOCCUPIED,
    WELL,
    WITHOUT_WORKER,
    Event,
    State,
    WorkerState,
)

E, S = Event, State

LIVES = {
    "a worker from elsewhere that learns of the end": [
        (E.JOIN, S.ADMITTED),
        (E.APPEAR, S.OPENING),
        (E.OPEN, S.READY),
        (E.BEGIN, S.RUNNING),
        (E.FINISH, S.DONE),
        (E.END, S.ENDING),
        (E.ACKNOWLEDGE, S.INFORMED),
        (E.LOSE, S.LEFT),
    ],
    "one that dies at work, and another of this machine": [
        (E.START, S.STARTING),
        (E.JOIN, S.ADMITTED),
        (E.APPEAR, S.OPENING),
        (E.OPEN, S.READY),
        (E.BEGIN, S.RUNNING),
        (E.LOSE, S.VACANT),
        (E.START, S.STARTING),
        (E.LOSE, S.VACANT),
        (E.START, S.STARTING),
    ],
    "one whose words come before its presence": [
        (E.JOIN, S.ADMITTED),
        (E.OPEN, S.READY),
        (E.APPEAR, None),
        (E.BEGIN, S.RUNNING),
    ],
    "one that is done and gone, and comes back to ask": [
        (E.JOIN, S.ADMITTED),
        (E.OPEN, S.READY),
        (E.BEGIN, S.RUNNING),
        (E.FINISH, S.DONE),
        (E.LOSE, S.AWAY),
        (E.LOSE, None),
        (E.END, S.UNAWARE),
        (E.JOIN, S.LEFT),
    ],
    "one that is done and gone, and runs again": [
        (E.JOIN, S.ADMITTED),
        (E.OPEN, S.READY),
        (E.BEGIN, S.RUNNING),
        (E.FINISH, S.DONE),
        (E.LOSE, S.AWAY),
        (E.JOIN, S.ADMITTED),
    ],
    "one that failed, and waits for the end of the run": [
        (E.JOIN, S.ADMITTED),
        (E.OPEN, S.READY),
        (E.BEGIN, S.RUNNING),
        (E.FAIL, S.FAILED),
        (E.END, S.ENDING),
        (E.LOSE, S.UNAWARE),
        (E.JOIN, S.LEFT),
    ],
    "one that was let in as the run ended": [(E.JOIN, S.ADMITTED), (E.END, S.LEFT)],
}


@pytest.mark.parametrize("life", LIVES)
def test_each_event_leads_to_the_next_state(life):
    slot = WorkerState(0.0)
    for event, expected in LIVES[life]:
        before = slot.state
        assert slot.on(event) == (expected is not None)
        assert slot.state is (expected or before)


def test_the_diagram_has_every_state_and_event():
    drawn = set(re.findall(r"\b[A-Z]{4,}\b", worker_state.__doc__))
    assert drawn == {state.name for state in State}
    events = {event.name.lower() for event in Event}
    assert events <= set(re.findall(r"\b[a-z]+\b", worker_state.__doc__))
    assert {event for _, event in TRANSITIONS} == {*Event}
    assert {state for state, _ in TRANSITIONS} == {*State} - {State.LEFT}


def test_every_state_is_reached_from_the_first_and_every_state_leads_to_the_last():
    def reached(start):
        found, new = {start}, [start]
        while new:
            here = new.pop()
            for (state, _), following in TRANSITIONS.items():
                if state is here and following not in found:
                    found.add(following)
                    new.append(following)
        return found

    assert reached(S.VACANT) == {*State}
    assert all(S.LEFT in reached(state) for state in State)


def test_only_deaths_at_one_tick_count_as_deaths_in_a_row():
    slot, counted = WorkerState(0.0), []
    for closed in (-1, -1, 5, 5, 5, 6, 5):
        slot.start(0.0)
        slot.lose(closed, 0.0)
        counted.append(slot.deaths)
    assert counted == [1, 2, 1, 2, 3, 1, 1]


def test_the_wait_begins_at_joining_for_remote_and_at_start_for_local_workers():
    slot = WorkerState(0.0)
    slot.start(10.0)
    assert [slot.never_joined(10.0 + t) for t in (0.0, STARTING_UP - 1, STARTING_UP)] == [
        False,
        False,
        True,
    ]
    slot.join("first", 20.0)
    assert not slot.never_joined(1e6)
    assert [slot.never_appeared(20.0 + t) for t in (0.0, APPEARING - 1, APPEARING)] == [
        False,
        False,
        True,
    ]
    slot.on(Event.APPEAR)
    assert not slot.never_appeared(1e6)


def test_a_process_that_ends_after_its_last_tick_is_not_restarted():
    slot = WorkerState(0.0)
    slot.start(0.0)
    slot.join("first", 1.0)
    for event in (E.APPEAR, E.OPEN, E.BEGIN, E.FINISH):
        slot.on(event)
    assert slot.lose(7, 2.0)
    assert (slot.state, slot.deaths) == (S.AWAY, 0)
    assert not slot.never_joined(1e6)
    assert slot.state in WELL - WITHOUT_WORKER


def test_catching_up_progresses_when_each_request_is_for_a_later_tick():
    slot = WorkerState(0.0, State.READY)
    assert slot.begin(9)
    assert [slot.catch_up(k, 9) for k in (0, 0, 4, 3, 9, 10)] == [
        *(True, False, True, False, True, False),
    ]
    assert not slot.begin(12)
    assert slot.recorded == 9


events = st.lists(st.sampled_from(Event), max_size=60)
LIVING = {S.ADMITTED, S.OPENING, S.READY, S.RUNNING, S.DONE, S.FAILED, S.ENDING, S.INFORMED}


def happen(slot, event, now, closed):
    """Let an event happen by the method that it has."""
    return {
        E.START: lambda: slot.start(now),
        E.JOIN: lambda: slot.join(f"session {now}", now),
        E.BEGIN: lambda: slot.begin(closed),
        E.LOSE: lambda: slot.lose(closed, now),
    }.get(event, lambda: slot.on(event))()


@given(events)
def test_events_without_a_transition_change_nothing(happened):
    slot, closed = WorkerState(0.0), -1
    for now, event in enumerate(happened, 1):
        closed += now % 3 == 0
        before = (slot.state, slot.incarnation, slot.since, slot.deaths, slot.recorded)
        following = TRANSITIONS.get((slot.state, event))
        assert happen(slot, event, float(now), closed) == (following is not None)
        assert slot.state is (following or before[0])
        if following is None:
            after = (slot.state, slot.incarnation, slot.since, slot.deaths, slot.recorded)
            assert after == before
        assert (
            (slot.incarnation is None) == (slot.state in UNOCCUPIED) == (slot.state not in LIVING)
        )


@given(events, events)
def test_after_the_end_no_worker_joins_or_begins(before, after):
    slot = WorkerState(0.0)
    for event in [*before, E.END]:
        happen(slot, event, 1.0, 0)
    for event in after:
        assert slot.state in {S.ENDING, S.INFORMED, S.UNAWARE, S.LEFT}
        happen(slot, event, 2.0, 0)
        assert slot.state is not S.LEFT or not any(happen(slot, e, 3.0, 0) for e in Event)
    assert slot.deaths <= before.count(E.LOSE)


class Worker:
    """A worker as the protocol has it: it says one thing after the other, on a link that breaks."""

    def __init__(self):
        self.said, self.link, self.knows = 0, True, False

    WORDS = (E.JOIN, E.APPEAR, E.OPEN, None, E.FINISH, None)
    """None: it waits to be told something, to begin or that the run is over."""

    def says(self):
        """Return the next that it says; None while it waits."""
        if not self.link:  # it asks to be let in again
            self.said, self.link = 0, True
        word = self.WORDS[self.said]
        self.said += word is not None
        return word


@given(st.lists(st.sampled_from(["worker", "orchestrator", "cut", "lost word"]), max_size=80))
def test_back_to_back_with_a_worker_every_run_comes_to_its_end(schedule):
    """Whatever the order and the breaks, when the link holds at last: all is done, and known."""
    slot, worker = WorkerState(0.0), Worker()

    def speak(lost=False):
        word = worker.says()
        if lost:  # with its link: what is said on a link comes in order, or the link is gone
            cut()
        elif word is not None:
            happen(slot, word, 0.0, 0)

    def cut():
        if worker.said:
            slot.lose(0, 0.0)
        worker.link = False

    def act():
        if slot.begin(0):
            worker.said = 4

    acts = {"worker": speak, "orchestrator": act, "cut": cut, "lost word": lambda: speak(lost=True)}
    for who in schedule:
        acts[who]()
    for _ in range(len(Worker.WORDS)):
        speak()
        act()
    assert slot.state in {S.DONE, S.AWAY}
    slot.on(E.END)
    if slot.state is S.UNAWARE:
        assert slot.join("again", 0.0)
    else:
        assert slot.on(E.ACKNOWLEDGE)
        assert slot.lose(0, 0.0)
    assert slot.state is S.LEFT
