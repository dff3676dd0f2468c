"""Which home a host gets, and what it is told when it gets none; no process is started."""

from importlib.metadata import version

import pytest

from nrs_cosim.orchestrator.hosts.homes import Home, Homes, NotLetInError
from nrs_cosim.orchestrator.hosts.notes import Hello, Report

VERSION = version("nrs-cosim")


def hello(robots=None, incarnation="a", of=VERSION):
    return Hello(version=of, incarnation=incarnation, robots=robots, public=bytes(32))


def let_in(homes, name, robots=None, incarnation=None):
    """Let a host in under its name, as the id of its session; return its robots."""
    home = homes.place(name, hello(robots, incarnation or name))
    home.admit(incarnation or name)
    return list(home.robots)


def refused(homes, name, note):
    with pytest.raises(NotLetInError) as caught:
        homes.place(name, note)
    return str(caught.value), caught.value.final


def test_hosts_that_name_no_robots_share_them():
    homes = Homes(7, 3)
    assert [let_in(homes, name) for name in "abc"] == [[1, 2, 3], [4, 5], [6, 7]]
    assert list(homes.free) == []
    assert homes.missing() == ""


def test_a_host_more_than_expected_takes_what_is_left():
    homes = Homes(4, 1)
    assert let_in(homes, "a", (2,)) == [2]
    assert let_in(homes, "b") == [1, 3, 4]


def test_robots_that_are_named_are_had_in_order():
    homes = Homes(5, 1)
    assert let_in(homes, "a", (4, 1)) == [1, 4]
    assert list(homes.free) == [2, 3, 5]
    assert homes.missing() == "; missing: robots 2-3, 5"


@pytest.mark.parametrize(
    ("robots", "asks_for"), [((), "none"), ((1, 4), "robots 1, 4"), ((6,), "robot 6")]
)
def test_robots_that_are_not_free_are_refused(robots, asks_for):
    homes = Homes(5, 1)
    let_in(homes, "a", (4,))
    why, final = refused(homes, "b", hello(robots))
    assert why == (
        f"--robots: robots 1-3, 5 of 5 have no home yet, but this host asks for {asks_for}"
    )
    assert final
    assert list(homes) == ["a"]


def test_another_version_is_refused_for_good():
    why, final = refused(Homes(2, 1), "a", hello(of="0.0.0"))
    assert f"the run is of nrs-cosim {VERSION}, the host of 0.0.0" in why
    assert final


@pytest.mark.parametrize("incarnation", ["first", "second"])
def test_a_name_that_is_taken_is_refused_for_now_whoever_asks(incarnation):
    """The id of a session is no secret, so it does not show that its owner asks."""
    homes = Homes(2, 1)
    let_in(homes, "a", incarnation="first")
    assert refused(homes, "a", hello(incarnation=incarnation)) == (
        "there is a host of the name 'a' already",
        False,
    )


def test_a_host_that_comes_again_has_the_robots_of_its_name_and_no_others():
    homes = Homes(4, 1)
    let_in(homes, "a", (1, 3))
    homes["a"].admit(None)
    assert homes.missing() == "; missing: robots 2, 4, host a"
    assert homes.place("a", hello((1, 3), "again")) is homes["a"]
    assert homes.place("a", hello(None, "again")) is homes["a"]
    why, final = refused(homes, "a", hello((1, 2), "again"))
    assert why == "--robots: 'a' has robots 1, 3 in this run, not robots 1-2"
    assert final


def test_without_a_free_robot_the_places_that_are_vacant_are_named():
    homes = Homes(3, 1)
    let_in(homes, "a", (1, 2))
    let_in(homes, "b", (3,))
    assert refused(homes, "c", hello()) == ("every robot has a home", True)
    homes["a"].admit(None)
    assert refused(homes, "c", hello()) == (
        "every robot has a home; take the place of a (robots 1-2) by --name",
        False,
    )


def test_a_host_that_goes_for_good_frees_its_robots():
    homes = Homes(4, 1)
    let_in(homes, "a", (1, 4))
    del homes["a"]
    assert list(homes.free) == [1, 2, 3, 4]
    assert let_in(homes, "b") == [1, 2, 3, 4]


def test_robots_are_homeless_until_their_host_is_ready():
    homes = Homes(3, 1)
    let_in(homes, "a", (1, 3))
    assert [robot for robot, _ in homes.homeless()] == [1, 3]
    homes["a"].begin = lambda _data: None
    assert list(homes.homeless()) == []
    homes["a"].admit("another")
    assert [robot for robot, _ in homes.homeless()] == [1, 3]
    homes["a"].is_ready = True
    assert list(homes.homeless()) == []


def test_another_host_has_all_before_it():
    home = Home([1])
    home.admit("first")
    home.present = home.is_ready = home.is_away = home.knows = True
    home.begin, home.report = (lambda _data: None), Report(tick=3)
    home.admit("second")
    assert home.incarnation == "second"
    assert not any((home.present, home.is_ready, home.is_away, home.knows, home.begin))
    assert home.seconds >= 0


def test_plants_that_are_alike_are_told_once_whatever_host_they_are_on():
    homes = Homes(5, 2)
    let_in(homes, "a", (2, 5))
    let_in(homes, "b", (1, 3, 4))
    homes["a"].plants = [{"fmu": "arm", "robots": [2, 5]}]
    homes["b"].plants = [{"fmu": "arm", "robots": [1, 4]}, {"fmu": "other", "robots": [3]}]
    assert homes.told() == [
        {"fmu": "arm", "robots": [1, 2, 4, 5]},
        {"fmu": "other", "robots": [3]},
    ]
