"""A recording with its robots in 3D, in the well-known types that Foxglove shows unaided.

    /scene    foxglove.SceneUpdate, once: what each link looks like, in a frame of its own
    /tf       foxglove.FrameTransforms, at each output time: where the frames are

Robots are drawn by their URDFs, see `robots.placed`; the target, a pale one, moves at the sampling
times. Neither channel is counted, so the digest stays.
"""

from collections.abc import Iterable, Sequence
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


def write_scene(reader: Reader, path: str | PathLike[str], placed: Sequence[PlacedRobot]) -> None:
    """Write a new recording that also shows robots, the target first.

    Raises `UncreatableError` when there is a file already, or none can be made.
    """
    types, of_target = recorded_types(reader), MovingFrames(placed[:1], [0])
    of_robots = MovingFrames(placed[1:], range(1, robots(reader) + 1))
    shows = types.codecs[SAMPLES.kind].shapes.get("position") == (about(reader).run.joints,)
    kinds = {SCENE: SceneUpdate.DESCRIPTOR, TF: FrameTransforms.DESCRIPTOR}
    channels = [Channel(topic, kind.full_name, counted=False) for topic, kind in kinds.items()]
    schemas = [Schema(kind.full_name, _described(kind.file)) for kind in kinds.values()]
    with copy_of(reader, path, {}, channels, schemas) as writer:
        for number, columns in enumerate(reader.columns()):
            added: list[Message] = []
            if not number:
                time_ns, k = int(columns.time[0]), int(columns.sequence[0])
                still = [transform for robot in placed for transform in _still(robot)]
                scene = SceneUpdate(entities=_entities(placed, time_ns))
                added.append((time_ns, SCENE, k, scene.SerializeToString()))
                added.append((time_ns, TF, k, _transforms(time_ns, still).SerializeToString()))
            for table, frames in ((STATES, of_robots), (SAMPLES, of_target)):
                found = rows_of(reader, types, table, columns)
                if found is None or not frames.names or not (table is STATES or shows):
                    continue
                mine = found if table is STATES else found[found["robot"] == 0]
                for row, at in zip(
                    mine[:: frames.robots], frames.at(mine["position"]), strict=True
                ):
                    moved = zip(frames.names, at, strict=True)
                    message = _transforms(int(row["time_ns"]), moved).SerializeToString()
                    added.append((int(row["time_ns"]), TF, int(row["k"]), message))
            writer.write([*columns.messages(reader.topics), *added])
        writer.finish(*ending(reader))


Transform = tuple[tuple[str, str], NDArray[np.float64]]
"""The parent and the child frame, and seven numbers."""


def _still(robot: PlacedRobot) -> Iterable[Transform]:
    return zip(*robot.still, strict=True)


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
