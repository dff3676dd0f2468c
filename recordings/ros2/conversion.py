"""A recording as a bag of ROS 2, a chunk at a time.

    /robot_3/joint_states        sensor_msgs/JointState    what the joints do, on the output grid
    /robot_3/reference           sensor_msgs/JointState    what they follow, without efforts
    /target/joint_states         sensor_msgs/JointState    the target at t_k, without efforts
    /tf                          tf2_msgs/TFMessage        the frames of joints that move
    /tf_static                   tf2_msgs/TFMessage        the others and the bases, once
    /robot_3/robot_description   std_msgs/String           each robot's URDF, once
    /rosout                      rcl_interfaces/Log        what links did to samples

Times are the recording's, from an epoch on; a message's stamp is its time in the bag. A robot of
which no URDF is known has joints and no frames, and so has a target of other quantities.
"""

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.keys import node_name
from nrs_cosim.bus.topics import Topics
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.export.selection import NOTHING
from nrs_cosim.recordings.export.tables import LINK_EVENTS, SAMPLES, STATES, rows_of
from nrs_cosim.recordings.link_event_words import described
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.ordering import concatenated, order, ranks
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.robots.frames import MovingFrames
from nrs_cosim.recordings.robots.placed import PlacedRobot, own_urdf, placed_robots
from nrs_cosim.recordings.ros2 import cdr
from nrs_cosim.recordings.ros2.bag import Topic, new_bag
from nrs_cosim.recordings.ros2.definitions import INFO, JOINT_STATE, LOG, STRING, TF, WARN, RosType
from nrs_cosim.recordings.schemas import about, recorded_types

Rows = NDArray[np.void]
Array = NDArray[np.float64]


def convert(
    reader: Reader,
    output: Path,
    *,
    robots: Collection[int] | None = None,
    start_ns: int | None = None,
    end_ns: int | None = None,
    epoch_ns: int = 0,
) -> int:
    """Write messages of all robots or some, start_ns <= time < end_ns; return how many there are.

    `UncreatableError` is as for `new_bag`, `UnreadableError` as for `placed_robots`.
    """
    made = Conversion(reader, robots, epoch_ns)
    version = reader.library.removeprefix("nrs-cosim ")
    with new_bag(output, made.topics, version) as bag:
        for messages in made.stretches(start_ns, end_ns):
            bag.put(messages)
        if not bag.counts:
            raise UnreadableError(f"{reader.path}: {NOTHING}")
    return bag.counts.total()


class Conversion:
    """What topics there are, and what is put on each of a recording: of all robots, or some."""

    def __init__(
        self, reader: Reader, robots: Collection[int] | None = None, epoch_ns: int = 0
    ) -> None:
        robots = sorted(robots or range(1, about(reader).run.robots + 1))
        self._reader, self._types, self._epoch_ns = reader, recorded_types(reader), epoch_ns
        self.topics: list[Topic] = []
        run, there = about(reader).run, {*reader.topics.values()}
        names = {i: [j.name for j in group.joints] for group in run.plants for i in group.robots}
        names[0] = names[robots[0]]
        placed = placed_robots(reader, robots)
        bases = {robot.number: robot.frame(robot.description.base) for robot in placed}

        def joints(topic: str, numbers: Sequence[int], *, effort: bool) -> _JointStates:
            made = [
                cdr.joint_state(bases.get(i, node_name(i)), names[i], effort=effort)
                for i in numbers
            ]
            on = self._add(*(f"/{node_name(i)}/{topic}" for i in numbers), of=JOINT_STATE)
            return _JointStates(made, numbers, on)

        of_run = Topics.among(there, run.robots)
        self._robots = robots
        self.read = of_run.all_of("state", robots)
        self._joints = joints("joint_states", robots, effort=True)
        self._references = joints("reference", robots, effort=False)
        self._target: _JointStates | None = None
        sent = self._types.codecs["sample"].shapes
        if all(sent.get(name) == (run.joints,) for name in ("position", "velocity")):
            self.read.append(of_run.of("sample", 0))
            self._target = joints("joint_states", [0], effort=False)
        self._frames: list[tuple[int, cdr.Templates, MovingFrames]] = []
        self._once: list[tuple[int, cdr.Templates, dict[str, Any]]] = []
        if placed:
            on = self._add("/tf", of=TF)
            for those, of in ((placed[1:], robots), (placed[:1], [0])):
                moving = MovingFrames(those, of)
                templates = cdr.Templates.of([cdr.transforms(moving.names)])
                self._frames.append((on, templates, moving))
            self._describe(placed if self._target else placed[1:])
        events = [topic for topic in of_run.all_of("link_event", robots) if topic in there]
        self.read += events
        self._log = self._add("/rosout", of=LOG) if events else 0

    def _add(self, *names: str, of: RosType, latched: bool = False) -> int:
        """Add topics of a type; return the number of the first one."""
        self.topics += [Topic(name, of, latched) for name in names]
        return len(self.topics) - len(names) + 1

    def _describe(self, placed: Sequence[PlacedRobot]) -> None:
        """Have what never changes put once."""
        still = [robot.still for robot in placed]
        frames = [frame for of_robot, _ in still for frame in of_robot]
        where = np.concatenate([at for _, at in still])[np.newaxis]
        on = self._add("/tf_static", of=TF, latched=True)
        self._once.append((on, cdr.Templates.of([cdr.transforms(frames)]), {"frame": where}))
        for robot in placed:
            on = self._add(f"/{robot.name}/robot_description", of=STRING, latched=True)
            self._once.append((on, cdr.Templates.of([cdr.string(own_urdf(robot))]), {}))

    def stretches(
        self, start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[Columns]:
        """Yield messages of start_ns <= time < end_ns, a chunk's in the order of time and topics.

        Channels are topics by their numbers, 1, 2, …
        """
        rank = ranks({number: topic.name for number, topic in enumerate(self.topics, 1)})
        for chunk in self._reader.columns(self.read, start_ns, end_ns):
            if parts := [part for part in self._parts(chunk) if len(part.channel)]:
                messages = concatenated(parts)
                yield messages.at(order(messages, rank))

    def _parts(self, messages: Columns) -> list[Columns]:
        """Return what messages of whole ticks become."""
        states, targets, events = (
            rows_of(self._reader, self._types, table, messages, of)
            for table, of in ((STATES, self._robots), (SAMPLES, [0]), (LINK_EVENTS, self._robots))
        )
        parts: list[Columns] = []

        def add(
            channel: Any,
            templates: cdr.Templates,
            which: NDArray[np.intp],
            rows: Rows,
            **values: Any,
        ) -> None:
            times = rows["time_ns"] + self._epoch_ns
            if "stamp" in templates.places:
                values["stamp"] = cdr.stamps(times)
            data, starts, stops = templates.filled(which, values)
            channels = np.full(len(rows), channel, np.uint16)
            parts.append(Columns(data, channels, rows["k"], times.astype(np.uint64), starts, stops))

        first = np.zeros(1, [("time_ns", "i8"), ("k", "u4")])
        first["time_ns"], first["k"] = messages.time[0], messages.sequence[0]
        for on, templates, values in self._once:
            add(on, templates, np.zeros(1, np.intp), first, **values)
        self._once = []
        followed = {"position": "reference_position", "velocity": "reference_velocity"}
        own = {name: name for name in ("position", "velocity", "effort")}
        for rows, of, fields in (
            (states, self._joints, own),
            (states, self._references, followed),
            (targets, self._target, {name: name for name in followed}),
        ):
            if rows is not None and of is not None:
                which = of.row[rows["robot"]]
                numbers = {name: rows[field] for name, field in fields.items()}
                add(of.channel + which, of.templates, which, rows, **numbers)
        for rows, (on, templates, frames) in zip((states, targets), self._frames, strict=False):
            if rows is not None and frames.names:
                at = rows[:: frames.robots]
                add(on, templates, np.zeros(len(at), np.intp), at,
                    frame=frames.at(rows["position"]))  # fmt: skip
        if events is not None:
            templates, which = _logged(events)
            add(self._log, templates, which, events)
        return parts


class _JointStates:
    """Topics of joints, a robot's each, from the number `channel` on."""

    def __init__(self, made: Sequence[cdr.Template], robots: Sequence[int], channel: int) -> None:
        self.templates, self.channel = cdr.Templates.of(made), channel
        self.row = np.zeros(max(robots) + 1, np.intp)
        """Of each robot its template."""
        self.row[[*robots]] = np.arange(len(robots))


def _logged(events: Rows) -> tuple[cdr.Templates, NDArray[np.intp]]:
    """Return what is said of link events, each once, and which is said of each row."""
    said, which = described(events)
    templates = [
        cdr.log(WARN if missed else INFO, node_name(robot), text) for robot, missed, text in said
    ]
    return cdr.Templates.of(templates), which
