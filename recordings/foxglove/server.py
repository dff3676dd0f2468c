"""A recording on a WebSocket of this machine, by Foxglove's protocol and SDK.

    the recording's topics      its own protobuf messages and schemas, none left out
    /scene, /tf, /link_events   the robots in 3D, and what links did, see `export.scene`
    /errors                     each robot's errors, only where it is known where the target is
    package://nrs/robot_3.urdf  assets: the URDF of each robot that has one, as it is drawn

Nothing else can be asked for: no path is ever opened, a URI is one of those or unknown. The SDK
keeps at most `BACKLOG` messages for a client and then drops the oldest ones, so that nobody waits
for a client that is slow; `falls_behind` is called when that happens. What never changes is sent to
whoever subscribes to it, for the protocol keeps no last message of a topic.
"""

import logging
from collections.abc import Callable, Iterator
from pathlib import Path
from threading import Condition, Thread
from time import monotonic
from typing import Self

from foxglove import Channel, Context, Schema, start_server
from foxglove.websocket import (
    Capability,
    ChannelView,
    Client,
    PlaybackControlRequest,
    PlaybackState,
    ServerListener,
)

from nrs_cosim.recordings.export.scene import Scene
from nrs_cosim.recordings.mcap import container
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import TargetAt
from nrs_cosim.recordings.robots.placed import own_urdf, placed_robots, shown_robots

HOST = "127.0.0.1"
BACKLOG = 2**16
"""Messages: some chunks of any recording, and some MB."""
ASSETS = "package://nrs/"
_SDK_LOG = "foxglove.websocket.connected_client.send_lossy"
"""Where the SDK says, now and then, that a client's messages are dropped."""
_CLOSING = 1.0
"""s: how long clients may take to be told that the server stops; some never read it."""
_SETTLED = 0.2
"""s: without another topic that somebody subscribes to."""

Control = Callable[[PlaybackControlRequest], PlaybackState]


class _Overflow(logging.Handler):
    """Notices that messages of a client are dropped, by the only words that the SDK has for it."""

    def __init__(self, noticed: Callable[[], None]) -> None:
        super().__init__(logging.INFO)
        self._noticed = noticed
        self._logger = logging.getLogger(_SDK_LOG)
        self._logger.setLevel(logging.INFO)
        self._logger.addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        del record
        self._noticed()

    def close(self) -> None:
        self._logger.removeHandler(self)
        super().close()


def _channels(reader: Reader, scene: Scene, context: Context) -> Iterator[tuple[str, Channel]]:
    """Yield the channels of a recording and of what is drawn of it, by their topics."""
    channels = [*reader.channels, *scene.channels]
    schemas = [*reader.schemas, *scene.schemas]
    data = {schema.name: schema.data for schema in schemas}
    for channel in channels:
        name = channel.schema_name
        schema = Schema(name=name, encoding="protobuf", data=data[name])
        yield (
            channel.topic,
            Channel(
                channel.topic,
                schema=schema,
                message_encoding="protobuf",
                metadata=dict(channel.metadata),
                context=context,
            ),
        )


def _time_of(message: container.Message) -> int:
    return message[0]


class Server(ServerListener):
    """A server of a recording; a context manager that stops it.

    With `played`, the times of the first and last message, clients may control the replay;
    `target_at` is as for `Scene`.
    """

    def __init__(
        self,
        reader: Reader,
        port: int,
        *,
        target_at: TargetAt | None = None,
        played: tuple[int, int] | None = None,
        control: Control | None = None,
        falls_behind: Callable[[], None] = lambda: None,
        backlog: int = BACKLOG,
    ) -> None:
        """Serve on a port, 0 for any; `OSError` where it is taken."""
        self.changed = Condition()
        """Notified when somebody subscribes to a topic, or to one less."""
        self._subscribed: set[tuple[int, str]] = set()
        self._since = 0.0
        self._control = control
        self._once: list[container.Message] = []
        self._time_ns = -1
        placed = placed_robots(reader)
        self._assets = {f"{ASSETS}{robot.name}.urdf": own_urdf(robot).encode() for robot in placed}
        self._scene = Scene(reader, shown_robots(reader), target_at)
        self._topics, self._context = reader.topics, Context()  # which is to live as long
        # All before it listens: what a client subscribes to, the SDK must know by then.
        self._channels = dict(_channels(reader, self._scene, self._context))
        self._overflow = _Overflow(falls_behind)
        try:
            self._server = start_server(
                name=Path(reader.path).name,
                host=HOST,
                port=port,
                capabilities=[Capability.Time],
                server_listener=self,
                asset_handler=self.asset,
                context=self._context,
                playback_time_range=played,
                message_backlog_size=backlog,
            )
        except RuntimeError as error:  # of the SDK, which has no other
            self._overflow.close()
            raise OSError(str(error)) from None
        self.port: int = self._server.port

    @property
    def subscriptions(self) -> int:
        """How many topics clients listen to, each counted by itself."""
        return len(self._subscribed)

    @property
    def has_listeners(self) -> bool:
        """Whether somebody listens, and has said to what: topics are named one after the other."""
        return bool(self._subscribed) and monotonic() - self._since >= _SETTLED

    def send(self, columns: Columns) -> None:
        """Send messages of whole ticks, and where the robots are by them; it waits for nobody."""
        messages = columns.messages(self._topics)
        if not self._once:
            self._once = self._scene.once(*messages[0][::2])
            self.send_once()
        messages = sorted([*messages, *self._scene.moved(columns)], key=_time_of)
        for time_ns, topic, _, data in messages:
            if time_ns != self._time_ns:
                self._time_ns = time_ns
                self._server.broadcast_time(time_ns)
            self._channels[topic].log(data, log_time=time_ns)

    def send_once(self, topic: str | None = None) -> None:
        """Send what never changes, on all topics or one, again."""
        for time_ns, on, _, data in self._once:
            if topic in (None, on):
                self._channels[on].log(data, log_time=time_ns)

    def tell(self, state: PlaybackState) -> None:
        """Tell all clients how far a replay is."""
        self._server.broadcast_playback_state(state)

    def asset(self, uri: str) -> bytes | None:
        """Return what a client asks for, None where the recording has none of that name."""
        return self._assets.get(uri)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Note who listens, who gets what never changes."""
        self.send_once(channel.topic)
        with self.changed:
            self._subscribed.add((client.id, channel.topic))
            self._since = monotonic()
            self.changed.notify_all()

    def on_unsubscribe(self, client: Client, channel: ChannelView) -> None:
        """Note who listens no more."""
        with self.changed:
            self._subscribed.discard((client.id, channel.topic))
            self.changed.notify_all()

    def on_playback_control_request(
        self, playback_control_request: PlaybackControlRequest
    ) -> PlaybackState | None:
        """Do as a client asks."""
        return self._control(playback_control_request) if self._control else None

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._overflow.close()
        # The SDK waits until each client has taken that it stops, however long.
        stopping = Thread(target=self._server.stop, daemon=True)
        stopping.start()
        stopping.join(_CLOSING)
