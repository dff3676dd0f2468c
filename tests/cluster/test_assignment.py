"""Which slot a worker gets, and what it is told when it gets none; no process is started."""

from importlib.metadata import version

import pytest

from nrs_cosim.orchestrator.cluster.assignment import Assignment, NotAdmittedError
from nrs_cosim.orchestrator.cluster.protocol import Hello
from nrs_cosim.orchestrator.cluster.worker_state import Event

VERSION, NOW = version("nrs-cosim"), 3.0


def hello(robots=None, incarnation="a", of=VERSION):
    return Hello(version=of, incarnation=incarnation, robots=robots, public=bytes(32))


def let_in(assignment, name, robots=None, incarnation=None):
    """Let a worker in under its name, as the id of its session; return its robots."""
    slot = assignment.place(name, hello(robots, incarnation or name), NOW)
    assert slot.life.join(incarnation or name, NOW)
    return list(slot.robots)


def lose(assignment, name):
    """Lose the worker of a slot."""
    assert assignment[name].life.lose(0, NOW)


def rejected(assignment, name, note):
    with pytest.raises(NotAdmittedError) as caught:
        assignment.place(name, note, NOW)
    return str(caught.value), caught.value.final


def test_workers_that_name_no_robots_share_them():
    assignment = Assignment(7, 3)
    assert [let_in(assignment, name) for name in "abc"] == [[1, 2, 3], [4, 5], [6, 7]]
    assert list(assignment.free) == []
    assert assignment.missing() == ""


def test_a_worker_beyond_the_expected_number_gets_the_remaining_robots():
    assignment = Assignment(4, 1)
    assert let_in(assignment, "a", (2,)) == [2]
    assert let_in(assignment, "b") == [1, 3, 4]


def test_named_robots_are_assigned_in_order():
    assignment = Assignment(5, 1)
    assert let_in(assignment, "a", (4, 1)) == [1, 4]
    assert list(assignment.free) == [2, 3, 5]
    assert assignment.missing() == "; missing: robots 2-3, 5"


@pytest.mark.parametrize(
    ("robots", "asks_for"),
    [
        ((), "none"),
        ((1, 4), "robots 1, 4"),
        ((5, 6, 7), "robots 5-7, and the run has no robots 6-7"),
    ],
)
def test_robots_that_are_not_free_are_refused(robots, asks_for):
    assignment = Assignment(5, 1)
    let_in(assignment, "a", (4,))
    why, final = rejected(assignment, "b", hello(robots))
    assert why == (
        f"--robots: robots 1-3, 5 of 5 have no worker yet, but this worker asks for {asks_for}"
    )
    assert final
    assert list(assignment) == ["a"]


def test_a_worker_of_another_version_is_refused_permanently():
    why, final = rejected(Assignment(2, 1), "a", hello(of="0.0.0"))
    assert f"the run is of nrs-cosim {VERSION}, the worker of 0.0.0" in why
    assert final


@pytest.mark.parametrize("incarnation", ["first", "second"])
def test_a_name_in_use_is_refused_for_now(incarnation):
    """The id of a session is no secret, so it does not show that its owner asks."""
    assignment = Assignment(2, 1)
    let_in(assignment, "a", incarnation="first")
    assert rejected(assignment, "a", hello(incarnation=incarnation)) == (
        "there is a worker of the name 'a' already",
        False,
    )


def test_a_returning_worker_gets_the_robots_of_its_name():
    assignment = Assignment(4, 1)
    let_in(assignment, "a", (1, 3))
    lose(assignment, "a")
    assert assignment.missing() == "; missing: robots 2, 4, worker a"
    assert assignment.place("a", hello((1, 3), "again"), NOW) is assignment["a"]
    assert assignment.place("a", hello(None, "again"), NOW) is assignment["a"]
    why, final = rejected(assignment, "a", hello((1, 2), "again"))
    assert why == "--robots: 'a' has robots 1, 3 in this run, not robots 1-2"
    assert final


def test_when_no_robot_is_free_the_vacant_slots_are_named():
    assignment = Assignment(3, 1)
    let_in(assignment, "a", (1, 2))
    let_in(assignment, "b", (3,))
    assert rejected(assignment, "c", hello()) == ("every robot has a worker", True)
    lose(assignment, "a")
    assert rejected(assignment, "c", hello()) == (
        "every robot has a worker; take the place of a (robots 1-2) by --name",
        False,
    )


def test_a_worker_that_leaves_permanently_frees_its_robots():
    assignment = Assignment(4, 1)
    let_in(assignment, "a", (1, 4))
    del assignment["a"]
    assert list(assignment.free) == [1, 2, 3, 4]
    assert let_in(assignment, "b") == [1, 2, 3, 4]


def test_robots_are_without_a_worker_until_it_is_ready():
    assignment = Assignment(3, 1)
    let_in(assignment, "a", (1, 3))
    assert list(assignment.without_worker()) == [(1, NOW), (3, NOW)]
    assignment["a"].life.on(Event.OPEN)
    assert list(assignment.without_worker()) == []
    lose(assignment, "a")
    assert list(assignment.without_worker()) == [(1, NOW), (3, NOW)]


def test_a_worker_that_is_done_and_gone_may_come_back_to_its_robots():
    assignment = Assignment(3, 1)
    let_in(assignment, "a", (1, 3))
    for event in (Event.OPEN, Event.BEGIN, Event.FINISH):
        assert assignment["a"].life.on(event)
    assert rejected(assignment, "a", hello())[1] is False
    lose(assignment, "a")
    assert list(assignment.without_worker()) == []
    assert let_in(assignment, "a", incarnation="again") == [1, 3]


def test_equal_plants_are_listed_once_across_workers():
    assignment = Assignment(5, 2)
    let_in(assignment, "a", (2, 5))
    let_in(assignment, "b", (1, 3, 4))
    assignment["a"].plants = [{"fmu": "arm", "robots": [2, 5]}]
    assignment["b"].plants = [{"fmu": "arm", "robots": [1, 4]}, {"fmu": "other", "robots": [3]}]
    assert assignment.describe_plants() == [
        {"fmu": "arm", "robots": [1, 2, 4, 5]},
        {"fmu": "other", "robots": [3]},
    ]
