"""A recording with its robots in 3D, in the well-known types that Foxglove shows unaided.

    /scene          foxglove.SceneUpdate, once: what each link looks like, and whose it is
    /tf             foxglove.FrameTransforms, at each output time: where the frames are
    /link_events    foxglove.Log: what links did to samples
    /errors         nrs.Errors, at each output time: each robot's errors, where the target is known

Robots are drawn by their URDFs, or as points in the space of their first three joints, see
`robots.placed`. The target, a pale one, moves at the output times too where it is known then, else
at the sampling times. None of these channels is counted, so the digest stays.
"""

from collections.abc import Iterable, Iterator, Sequence
from os import PathLike
from typing import Any

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.TextPrimitive_pb2 import TextPrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from nrs_cosim.bus.keys import node_name
from nrs_cosim.recordings.export.tables import (
    LINK_EVENTS,
    SAMPLES,
    STATES,
    MessageTable,
    robots,
    rows_of,
)
from nrs_cosim.recordings.link_event_words import described
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import Channel, Message, Schema
from nrs_cosim.recordings.mcap.copy import copy_of, ending
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.measurement import QUANTITIES, TargetAt
from nrs_cosim.recordings.robots.description import Shape
from nrs_cosim.recordings.robots.frames import MovingFrames
from nrs_cosim.recordings.robots.kinematics import quaternion
from nrs_cosim.recordings.robots.placed import PlacedRobot
from nrs_cosim.recordings.schemas import about, recorded_types

SCENE, TF, EVENTS, ERRORS = "/scene", "/tf", "/link_events", "/errors"
_NS_PER_S = 10**9
_ABOVE = 0.2
"""m: of a label above what it is of."""


_ERRORS = FileDescriptorProto(
    name="nrs/errors.proto",
    package="nrs",
    syntax="proto3",
    message_type=[
        DescriptorProto(
            name="Errors",
            field=[
                FieldDescriptorProto(
                    name=name,
                    number=number,
                    type=FieldDescriptorProto.TYPE_DOUBLE,
                    label=FieldDescriptorProto.LABEL_REPEATED,
                )
                for number, name in enumerate(QUANTITIES, 1)
            ],
        )
    ],
)
"""A number a robot, in the order of their numbers: the norms that `measurement` has."""
_POOL = DescriptorPool()
_POOL.Add(_ERRORS)
Errors: Any = GetMessageClass(_POOL.FindMessageTypeByName("nrs.Errors"))
KINDS: dict[str, Any] = {
    SCENE: SceneUpdate.DESCRIPTOR,
    TF: FrameTransforms.DESCRIPTOR,
    EVENTS: Log.DESCRIPTOR,
    ERRORS: Errors.DESCRIPTOR,
}


class Scene:
    """What is shown of a recording's robots beside its own messages; the target is the first."""

    def __init__(
        self, reader: Reader, placed: Sequence[PlacedRobot], target_at: TargetAt | None = None
    ) -> None:
        """Show robots; with `target_at`, the target and errors at all output times."""
        self._reader, self._placed, self._types = reader, placed, recorded_types(reader)
        shape = self._types.codecs[SAMPLES.kind].shapes.get("position")
        shows = shape == (about(reader).run.joints,)
        self._n, self._target_at = robots(reader), target_at
        self._robots = MovingFrames(placed[1:], range(1, self._n + 1))
        self._target = MovingFrames(placed[:1], [0])
        self._sampled = shows and target_at is None
        kinds = {topic: kind for topic, kind in KINDS.items() if target_at or topic != ERRORS}
        self.channels = [Channel(topic, of.full_name, counted=False) for topic, of in kinds.items()]
        self.schemas = [Schema(of.full_name, _described(of.file)) for of in kinds.values()]

    def once(self, time_ns: int, k: int) -> list[Message]:
        """Return what never changes, as of a time and tick."""
        still = [
            transform for robot in self._placed for transform in zip(*robot.still, strict=True)
        ]
        scene = SceneUpdate(entities=_entities(self._placed, time_ns))
        return [
            (time_ns, SCENE, k, scene.SerializeToString()),
            (time_ns, TF, k, _transforms(time_ns, still).SerializeToString()),
        ]

    def moved(self, columns: Columns) -> Iterator[Message]:
        """Yield where the frames are by messages of whole ticks, errors, and link events."""
        if (states := self._rows(STATES, columns)) is not None:
            yield from _moved(self._robots, states, states["position"])
            if self._target_at:
                yield from self._beside_target(states, self._target_at)
        if self._sampled and (sent := self._rows(SAMPLES, columns)) is not None:
            targets = sent[sent["robot"] == 0]
            yield from _moved(self._target, targets, targets["position"])
        if (events := self._rows(LINK_EVENTS, columns)) is not None:
            said, which = described(events)
            for event, (robot, missed, text) in zip(
                events, (said[at] for at in which), strict=True
            ):
                time_ns = int(event["time_ns"])
                level = Log.WARNING if missed else Log.INFO
                log = Log(
                    timestamp=_stamp(time_ns), level=level, name=node_name(robot), message=text
                )
                yield time_ns, EVENTS, int(event["k"]), log.SerializeToString()

    def _rows(self, table: MessageTable, columns: Columns) -> NDArray[np.void] | None:
        return rows_of(self._reader, self._types, table, columns)

    def _beside_target(self, states: NDArray[np.void], target_at: TargetAt) -> Iterator[Message]:
        """Yield where the target is at the times of states, and how far robots are from it."""
        position, velocity = target_at(states["t"])
        yield from _moved(self._target, states[:: self._n], position[:: self._n])
        norms = [
            np.linalg.norm(states[of + name] - truth, order, axis=1).reshape(-1, self._n)
            for of, order in (("reference_", np.inf), ("", 2))
            for name, truth in (("position", position), ("velocity", velocity))
        ]
        for row, *errors in zip(states[:: self._n], *norms, strict=True):
            message = Errors(**dict(zip(QUANTITIES, errors, strict=True)))
            yield int(row["time_ns"]), ERRORS, int(row["k"]), message.SerializeToString()


def _moved(
    frames: MovingFrames, rows: NDArray[np.void], position: NDArray[np.float64]
) -> Iterator[Message]:
    """Yield where frames are at the times of rows, of whole ticks, whose positions are given."""
    if not frames.names:
        return
    for row, at in zip(rows[:: frames.robots], frames.at(position), strict=True):
        time_ns, moved = int(row["time_ns"]), zip(frames.names, at, strict=True)
        yield time_ns, TF, int(row["k"]), _transforms(time_ns, moved).SerializeToString()


def write_scene(
    reader: Reader,
    path: str | PathLike[str],
    placed: Sequence[PlacedRobot],
    target_at: TargetAt | None = None,
) -> None:
    """Write a new recording that also shows robots, the target first.

    Raises `UncreatableError` when there is a file already, or none can be made.
    """
    scene = Scene(reader, placed, target_at)
    with copy_of(reader, path, {}, scene.channels, scene.schemas) as writer:
        for number, columns in enumerate(reader.columns()):
            once = [] if number else scene.once(int(columns.time[0]), int(columns.sequence[0]))
            writer.write([*columns.messages(reader.topics), *once, *scene.moved(columns)])
        writer.finish(*ending(reader))


Transform = tuple[tuple[str, str], NDArray[np.float64]]
"""The parent and the child frame, and seven numbers."""


def _described(file: FileDescriptor) -> bytes:
    """The serialized FileDescriptorSet of a file and all that it imports, those first."""
    found: dict[str, FileDescriptor] = {}

    def visit(one: FileDescriptor) -> None:
        for imported in one.dependencies:
            visit(imported)
        found[one.name] = one

    visit(file)
    described = FileDescriptorSet()
    for one in found.values():
        one.CopyToProto(described.file.add())
    return described.SerializeToString()


def _stamp(time_ns: int) -> Timestamp:
    return Timestamp(seconds=time_ns // _NS_PER_S, nanos=time_ns % _NS_PER_S)


def _entities(placed: Sequence[PlacedRobot], time_ns: int) -> list[SceneEntity]:
    """What all frames carry, for good."""
    entities = []
    for robot in placed:
        colour = Color(**dict(zip("rgba", robot.colour, strict=True)))
        described = robot.description
        labelled = described.base if described.reach else described.links[-1]
        for link, shapes in described.shapes.items():
            frame = robot.frame(link)
            entity = SceneEntity(
                timestamp=_stamp(time_ns), frame_id=frame, id=frame, frame_locked=True
            )
            _add(entity, shapes, colour)
            if link == labelled:
                entity.texts.append(_label(robot))
            entities += [entity] if shapes or entity.texts else []
    return entities


def _label(robot: PlacedRobot) -> TextPrimitive:
    """Return a robot's name beside its base, or beside itself where it is a point."""
    pose = Pose(position=_vector(0.0, 0.0, _ABOVE), orientation=Quaternion(w=1.0))
    colour = Color(**dict(zip("rgb", robot.colour[:3], strict=True)), a=1.0)
    name = robot.name.replace("_", " ")
    return TextPrimitive(
        pose=pose, billboard=True, font_size=14, scale_invariant=True, color=colour, text=name
    )


def _add(entity: SceneEntity, shapes: Sequence[Shape], colour: Color) -> None:
    for shape in shapes:
        pose = Pose(position=_vector(*shape.xyz), orientation=_quaternion(quaternion(shape.rpy)))
        match shape.kind:
            case "box":
                cube = CubePrimitive(pose=pose, size=_vector(*shape.size), color=colour)
                entity.cubes.append(cube)
            case "sphere":
                size = _vector(*(2 * shape.size[0],) * 3)
                entity.spheres.append(SpherePrimitive(pose=pose, size=size, color=colour))
            case _:
                radius, length = shape.size
                size = _vector(2 * radius, 2 * radius, length)
                rod = CylinderPrimitive(
                    pose=pose, size=size, bottom_scale=1, top_scale=1, color=colour
                )
                entity.cylinders.append(rod)


def _transforms(time_ns: int, frames: Iterable[Transform]) -> FrameTransforms:
    stamp = _stamp(time_ns)
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=stamp,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=_vector(*numbers[:3].tolist()),
                rotation=_quaternion(numbers[3:]),
            )
            for (parent, child), numbers in frames
        ]
    )


def _vector(x: float, y: float, z: float) -> Vector3:
    return Vector3(x=x, y=y, z=z)


def _quaternion(numbers: NDArray[np.float64]) -> Quaternion:
    x, y, z, w = numbers.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)
