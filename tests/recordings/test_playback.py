"""Where a replay is, by requests and the wall's time alone."""

import pytest

from nrs_cosim.recordings.foxglove.playback import FASTEST, SLOWEST, Playback, Status

S = 10**9
NEW = Playback.over(2 * S, 10 * S, 1.0)
PLAYING = NEW.requested("play", 2.0, None, 100.0)
PAUSED, PLAYS, ENDED = Status.PAUSED, Status.PLAYING, Status.ENDED


@pytest.mark.parametrize(
    ("before", "command", "seek", "status", "at"),
    [
        (NEW, "pause", None, PAUSED, 2),
        (NEW, "play", None, PLAYS, 2),
        (NEW, "pause", 5, PAUSED, 5),
        (NEW, "play", 1, PLAYS, 2),
        (NEW, "play", 99, PLAYS, 10),
        (PLAYING, "play", None, PLAYS, 8),
        (PLAYING, "pause", None, PAUSED, 8),
        (PLAYING, "play", 3, PLAYS, 3),
        (PLAYING.ended(), "play", None, ENDED, 10),
        (PLAYING.ended(), "pause", None, ENDED, 10),
        (PLAYING.ended(), "pause", 4, PAUSED, 4),
        (PLAYING.ended(), "play", 4, PLAYS, 4),
    ],
)
def test_a_request_changes_the_state_as_the_table_says(before, command, seek, status, at):
    after = before.requested(command, 1.0, None if seek is None else seek * S, 103.0)
    assert (after.status, after.position(103.0)) == (status, at * S)


@pytest.mark.parametrize(
    ("asked", "got"),
    [(0.5, 0.5), (1e9, FASTEST), (1e-9, SLOWEST)]
    + [(none, 2.0) for none in (0.0, -1.0, float("nan"), float("inf"))],
)
def test_a_speed_is_within_limits_and_one_that_is_none_changes_none(asked, got):
    assert PLAYING.requested("play", asked, None, 101.0).speed == got


def test_time_passes_as_long_as_it_plays_and_not_past_the_end():
    assert [PLAYING.position(wall) for wall in (100.0, 101.5, 104.0, 200.0)] == [
        2 * S, 5 * S, 10 * S, 10 * S,
    ]  # fmt: skip
    paused = PLAYING.requested("pause", 2.0, None, 101.5)
    assert paused.position(500.0) == 5 * S
    again = paused.requested("play", 2.0, None, 500.0)
    assert again.seconds_until(9 * S, 500.5) == pytest.approx(1.5)
    assert again.seconds_until(9 * S, 502.0) == 0
