"""A recording with its robots in 3D, in the well-known types that Foxglove shows unaided.

    /scene    foxglove.SceneUpdate, once: what each link looks like, in a frame of its own
    /tf       foxglove.FrameTransforms, at each output time: where the frames are

Robots are drawn by their URDFs, see `robots.placed`; the target, a pale one, moves at the sampling
times. Neither channel is counted, so the digest stays.
"""

from collections.abc import Iterable, Iterator, Sequence
from os import PathLike

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.CubePrimitive_pb2 import CubePrimitive
from foxglove_schemas_protobuf.CylinderPrimitive_pb2 import CylinderPrimitive
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Pose_pb2 import Pose
from foxglove_schemas_protobuf.Quaternion_pb2 import Quaternion
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from foxglove_schemas_protobuf.SpherePrimitive_pb2 import SpherePrimitive
from foxglove_schemas_protobuf.Vector3_pb2 import Vector3
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.timestamp_pb2 import Timestamp
from numpy.typing import NDArray

from nrs_cosim.recordings.export.tables import SAMPLES, STATES, robots, rows_of
from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import Channel, Message, Schema
from nrs_cosim.recordings.mcap.copy import copy_of, ending
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.robots.description import Shape
from nrs_cosim.recordings.robots.frames import MovingFrames
from nrs_cosim.recordings.robots.kinematics import quaternion
from nrs_cosim.recordings.robots.placed import PlacedRobot
from nrs_cosim.recordings.schemas import about, recorded_types

SCENE, TF = "/scene", "/tf"
_NS_PER_S = 10**9


KINDS = {SCENE: SceneUpdate.DESCRIPTOR, TF: FrameTransforms.DESCRIPTOR}


class Scene:
    """What is shown of a recording's robots beside its own messages; the target is the first."""

    channels = tuple(Channel(topic, kind.full_name, counted=False) for topic, kind in KINDS.items())

    def __init__(self, reader: Reader, placed: Sequence[PlacedRobot]) -> None:
        self._reader, self._placed, self._types = reader, placed, recorded_types(reader)
        shape = self._types.codecs[SAMPLES.kind].shapes.get("position")
        shows = shape == (about(reader).run.joints,)
        self._frames = {STATES: MovingFrames(placed[1:], range(1, robots(reader) + 1))}
        self._frames |= {SAMPLES: MovingFrames(placed[:1], [0])} if shows else {}
        self.schemas = [Schema(kind.full_name, _described(kind.file)) for kind in KINDS.values()]

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
        """Yield where the frames are by messages of whole ticks."""
        for table, frames in self._frames.items():
            found = rows_of(self._reader, self._types, table, columns)
            if found is None or not frames.names:
                continue
            mine = found if table is STATES else found[found["robot"] == 0]
            for row, at in zip(mine[:: frames.robots], frames.at(mine["position"]), strict=True):
                time_ns, moved = int(row["time_ns"]), zip(frames.names, at, strict=True)
                yield time_ns, TF, int(row["k"]), _transforms(time_ns, moved).SerializeToString()


def write_scene(reader: Reader, path: str | PathLike[str], placed: Sequence[PlacedRobot]) -> None:
    """Write a new recording that also shows robots, the target first.

    Raises `UncreatableError` when there is a file already, or none can be made.
    """
    scene = Scene(reader, placed)
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
        for link, shapes in robot.description.shapes.items():
            frame = robot.frame(link)
            entity = SceneEntity(
                timestamp=_stamp(time_ns), frame_id=frame, id=frame, frame_locked=True
            )
            _add(entity, shapes, colour)
            entities += [entity] if shapes else []
    return entities


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
