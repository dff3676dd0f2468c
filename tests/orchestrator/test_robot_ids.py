"""Which robots, or joints, a text names."""

import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.scenario.robot_ids import parse_joints, parse_robots


@pytest.mark.parametrize(
    ("text", "robots"),
    [("1", (1,)), ("1-3,7", (1, 2, 3, 7)), ("7, 1-3", (1, 2, 3, 7)), ("2-2", (2,))],
)
def test_robots_are_named_by_numbers_and_ranges(text, robots):
    assert parse_robots(text, "--robots", 7) == robots


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "got '' in ''"),
        ("1,,2", "got '' in '1,,2'"),
        ("a", "got 'a'"),
        ("-1", "got '-1'"),
        ("1.5", "got '1.5'"),
        ("١", "got '١'"),
        ("0-2", "robots count from 1"),
        ("3-1", "3 is more than 1"),
        ("6-8", "there are robots 1 to 7"),
        ("1-3,3", "robot 3 is named twice"),
    ],
)
def test_text_that_is_no_list_of_robots_is_refused(text, said):
    with pytest.raises(InputError, match=r"^--robots: ") as rejected:
        parse_robots(text, "--robots", 7)
    assert said in str(rejected.value)


def test_a_range_beyond_a_million_robots_is_refused():
    with pytest.raises(InputError, match="at most robot 1000000"):
        parse_robots("1-999999999", "--robots")


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("elbow", (2,)),
        ("2, hand,1", (1, 2, 3)),
        ("3-4,base", (1, 3, 4)),
        ("2,elbow", "joint 2 is named twice"),
        ("shoulder", "'shoulder' is joints 1, 3"),
        ("elbw", "no joint is called 'elbw'; did you mean 'elbow'?"),
        ("5", "there are joints 1 to 4"),
    ],
)
def test_joints_are_named_by_numbers_and_by_their_names_in_all_fmus(text, found):
    fmus = [["shoulder", "elbow", "hand", "3"], ["base", "elbow", "shoulder", "tip"]]
    if isinstance(found, tuple):
        assert parse_joints(text, "--joints", 4, fmus) == found
    else:
        with pytest.raises(InputError, match=r"^--joints: ") as rejected:
            parse_joints(text, "--joints", 4, fmus)
        assert found in str(rejected.value)
