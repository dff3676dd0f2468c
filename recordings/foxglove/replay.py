"""A recording played to whoever listens, who may pause it, seek a time, and change its speed.

It begins when somebody subscribes; a client that asks for anything itself is waited for to say so.
At a time that is sought the last messages of each topic before it are sent first.
"""

from collections.abc import Iterator
from itertools import count
from threading import Condition, Event, Thread
from time import monotonic

import numpy as np
from foxglove.websocket import (
    PlaybackCommand,
    PlaybackControlRequest,
    PlaybackState,
    PlaybackStatus,
)

from nrs_cosim.recordings.foxglove.playback import Command, Playback, Status
from nrs_cosim.recordings.foxglove.server import Server
from nrs_cosim.recordings.mcap.columns import MANY, Columns
from nrs_cosim.recordings.mcap.ordering import concatenated
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.schemas import about

_LOOKED_AT = 0.05
"""s: how often, whether somebody listens."""
_TOLD_AGAIN = 20
"""After so many looks clients are told how far it is."""
_STATUSES = {
    Status.PAUSED: PlaybackStatus.Paused,
    Status.PLAYING: PlaybackStatus.Playing,
    Status.ENDED: PlaybackStatus.Ended,
}


class Player:
    """Plays the messages of start_ns <= time <= end_ns; requests come in from other threads."""

    def __init__(self, reader: Reader, start_ns: int, end_ns: int, speed: float) -> None:
        self._reader = reader
        self._playback = Playback.over(start_ns, end_ns, speed)
        self._changed = Condition()
        self._sought = False
        """Whether another time was sought than what is read from."""
        self._is_controlled = self._stopped = False

    def control(self, request: PlaybackControlRequest) -> PlaybackState:
        """Do what a client asks for, and return what it came to."""
        command: Command = "play" if request.playback_command == PlaybackCommand.Play else "pause"
        with self._changed:
            self._is_controlled = True
            wall, to_ns = monotonic(), request.seek_time
            self._playback = self._playback.requested(command, request.playback_speed, to_ns, wall)
            self._sought |= to_ns is not None
            self._changed.notify_all()
            return self._state(wall, request.request_id, sought=to_ns is not None)

    def begin(self, server: Server) -> None:
        """Play for clients that listen, unless one of them controls it or it has begun."""
        with self._changed:
            if self._is_controlled or self._playback.status is not Status.PAUSED:
                return
            wall = monotonic()
            self._playback = self._playback.requested("play", 0.0, None, wall)
            self._changed.notify_all()
            server.tell(self._state(wall))

    def serve(self, server: Server, over: Event) -> None:
        """Play until it is over, from when somebody listens."""
        playing = Thread(target=self.play, args=[server])
        playing.start()
        for turn in count(1):
            if over.wait(_LOOKED_AT):
                break
            if server.has_listeners:
                self.begin(server)
            if turn % _TOLD_AGAIN == 0:
                # An answer that is under way may come after what is told of later.
                with self._changed:
                    server.tell(self._state(monotonic()))
        with self._changed:
            self._stopped = True
            self._changed.notify_all()
        playing.join()

    def play(self, server: Server) -> None:
        """Send what is due, until it is stopped."""
        start = self._playback.start_ns
        while True:
            if all(self._sent_when_due(server, part) for part in self._parts(start)):
                with self._changed:
                    if not self._sought:
                        self._playback = self._playback.ended()
                        server.tell(self._state(monotonic()))
            with self._changed:
                self._changed.wait_for(lambda: self._sought or self._stopped)
                if self._stopped:
                    return
                self._sought = False
                start = self._playback.at_ns
            server.send_once()
            if (last := self._last_before(start)) is not None:
                server.send(last)

    def _parts(self, start_ns: int) -> Iterator[Columns]:
        """Yield the messages of one time after the other."""
        for columns in self._reader.columns(None, start_ns, self._playback.end_ns + 1):
            ends = np.flatnonzero(np.diff(columns.time)) + 1
            for rows in np.split(np.arange(len(columns.time)), ends):
                yield columns.at(rows)

    def _sent_when_due(self, server: Server, part: Columns) -> bool:
        """Send messages at their time; return whether it came before something else was asked."""
        time_ns = int(part.time[0])
        with self._changed:
            while not (self._sought or self._stopped):
                wait = None
                if self._playback.status is Status.PLAYING:
                    wait = self._playback.seconds_until(time_ns, monotonic())
                if wait == 0:
                    break
                self._changed.wait(wait)
            else:
                return False
        server.send(part)
        return True

    def _last_before(self, time_ns: int) -> Columns | None:
        """Return the last messages before a time, of topics that had any in a sampling period."""
        period = about(self._reader).run.sampling_period_ns or 0
        parts = list(self._reader.columns(None, max(0, time_ns - period), time_ns))
        if not parts:
            return None
        late, last = concatenated(parts), np.zeros(MANY, np.uint64)
        np.maximum.at(last, late.channel, late.time)
        return late.only(late.time == last[late.channel])

    def _state(
        self, wall: float, request: str | None = None, *, sought: bool = False
    ) -> PlaybackState:
        now = self._playback
        return PlaybackState(_STATUSES[now.status], now.position(wall), now.speed, sought, request)
