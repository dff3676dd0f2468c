"""A recording with its robots in 3D, in the well-known types that Foxglove shows unaided.

    /scene    foxglove.SceneUpdate, once: what each link looks like, in a frame of its own
    /tf       foxglove.FrameTransforms, at each output time: where the frames are

The world has x ahead and z up. An arm moves in a plane of constant y, q1 from x towards z, every
other angle from the link before; the arms stand side by side. Points move in the x-y plane. The
target, robot 0, is a pale figure like robot 1, at the sampling times. Neither channel is counted,
so the digest stays.
"""

from collections.abc import Mapping
from math import sqrt
from os import PathLike

import numpy as np
from foxglove_schemas_protobuf.Color_pb2 import Color
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

from nrs_cosim.recordings.export.tables import SAMPLES, STATES, rows
from nrs_cosim.recordings.mcap.container import Channel, Message, Schema
from nrs_cosim.recordings.mcap.copy import copy_of, ending
from nrs_cosim.recordings.mcap.reader import Reader

SCENE, TF, WORLD = "/scene", "/tf", "world"
_NS_PER_S = 10**9
_ALONG_X = Quaternion(y=sqrt(0.5), w=sqrt(0.5))
"""Takes z, along which cylinders stand, to x, along which links lie."""
_COLOURS = ((0.12, 0.47, 0.71), (1.0, 0.5, 0.05), (0.17, 0.63, 0.17), (0.84, 0.15, 0.16))


Links = tuple[float, ...]
"""The lengths (m) of an arm's links; none of a point that moves in the plane."""


def write_scene(reader: Reader, path: str | PathLike[str], shapes: Mapping[int, Links]) -> None:
    """Write a new recording that also shows the robots whose links are known, by their numbers.

    Raises `UncreatableError` when there is a file already, or none can be made.
    """
    figures = {0: shapes[min(shapes)], **shapes}
    apart = 0.5 * max(sum(links) for links in figures.values())
    kinds = {SCENE: SceneUpdate.DESCRIPTOR, TF: FrameTransforms.DESCRIPTOR}
    channels = [Channel(topic, kind.full_name, counted=False) for topic, kind in kinds.items()]
    schemas = [Schema(kind.full_name, _described(kind.file)) for kind in kinds.values()]
    with copy_of(reader, path, {}, channels, schemas) as writer:
        for number, chunk in enumerate(reader.batches()):
            added = _moves(reader, figures, apart, chunk[0][0], chunk[-1][0] + 1)
            if not number:
                time_ns, _, k, _ = chunk[0]
                added.append((time_ns, SCENE, k, _figures(figures, time_ns).SerializeToString()))
            writer.write([*chunk, *added])
        writer.finish(*ending(reader))


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


def frame(robot: int, link: int) -> str:
    """Return the name of the frame of a robot's link, from 1; link 0 is the frame of a point."""
    return f"robot/{robot}/link/{link}" if link else f"robot/{robot}"


def _figures(figures: Mapping[int, Links], time_ns: int) -> SceneUpdate:
    """What all frames carry, for good."""
    scene = SceneUpdate()
    for robot, links in figures.items():
        red, green, blue = _COLOURS[robot % len(_COLOURS)] if robot else (0.6, 0.6, 0.6)
        colour = Color(r=red, g=green, b=blue, a=1.0 if robot else 0.4)
        thick = 0.06 * max(links, default=3.0)
        ball = SpherePrimitive(
            pose=Pose(position=Vector3(), orientation=Quaternion(w=1)),
            size=Vector3(x=1.5 * thick, y=1.5 * thick, z=1.5 * thick),
            color=colour,
        )
        for link, length in enumerate(links, 1) if links else ((0, 0.0),):
            rod = CylinderPrimitive(
                pose=Pose(position=Vector3(x=length / 2), orientation=_ALONG_X),
                size=Vector3(x=thick, y=thick, z=length),
                bottom_scale=1,
                top_scale=1,
                color=colour,
            )
            scene.entities.append(
                SceneEntity(
                    timestamp=_stamp(time_ns),
                    frame_id=frame(robot, link),
                    id=frame(robot, link),
                    frame_locked=True,
                    spheres=[ball],
                    cylinders=[rod] if link else [],
                )
            )
    return scene


def _moves(
    reader: Reader, figures: Mapping[int, Links], apart: float, start_ns: int, end_ns: int
) -> list[Message]:
    """The messages on `/tf` with start_ns <= log_time < end_ns."""
    found: dict[int, tuple[int, list[tuple[int, NDArray[np.float64]]]]] = {}
    for table, part in rows(reader, [SAMPLES, STATES], figures.keys(), start_ns, end_ns):
        if "position" not in (part.dtype.names or ()) or part["position"].ndim == 1:
            continue  # samples of an algorithm that does not send where the target is
        for row in part:
            if (table is SAMPLES) == (row["robot"] == 0):
                _, robots = found.setdefault(int(row["time_ns"]), (int(row["k"]), []))
                robots.append((int(row["robot"]), row["position"]))
    return [
        (time_ns, TF, k, _transforms(time_ns, robots, figures, apart).SerializeToString())
        for time_ns, (k, robots) in found.items()
    ]


def _transforms(
    time_ns: int,
    robots: list[tuple[int, NDArray[np.float64]]],
    figures: Mapping[int, Links],
    apart: float,
) -> FrameTransforms:
    stamp, made = _stamp(time_ns), []
    for robot, q in robots:
        links = figures[robot]
        if not links:
            x, y = (*q.tolist(), 0.0)[:2]
            made.append((WORLD, frame(robot, 0), Vector3(x=x, y=y), Quaternion(w=1)))
            continue
        parent, at = WORLD, Vector3(y=apart * robot)
        turns = zip(np.sin(-q / 2).tolist(), np.cos(q / 2).tolist(), links, strict=True)
        for link, (sine, cosine, length) in enumerate(turns, 1):
            made.append((parent, frame(robot, link), at, Quaternion(y=sine, w=cosine)))
            parent, at = frame(robot, link), Vector3(x=length)
    return FrameTransforms(
        transforms=[
            FrameTransform(
                timestamp=stamp,
                parent_frame_id=parent,
                child_frame_id=child,
                translation=at,
                rotation=rotation,
            )
            for parent, child, at, rotation in made
        ]
    )
