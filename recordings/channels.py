"""What a recording has room for: a channel for each thing that is told of each robot, and how.

A channel says what its messages are, which of a robot's joints their numbers belong to, and in
which units; what it takes to read them is in the file.
"""

import json
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.messages import CHECKPOINT, BlobType, Codec, MessageType
from nrs_cosim.bus.topics import Topics
from nrs_cosim.recordings.mcap.container import Channel, Schema
from nrs_cosim.recordings.units import field_unit


def channels(
    codecs: Codecs,
    n: int,
    faulty: Collection[int],
    checkpoints: bool,
    plants: Sequence[Mapping[str, Any]] = (),
    measuring: Iterable[int] = (),
) -> list[Channel]:
    """Return the channels of n robots and the target, with what `plants` tell of the robots.

    They are of the message types that `codecs` code; those of agent states only if there are any,
    and those of measurements for the robots that are `measuring` at some time. Those of link
    events, for robots whose links may do anything to samples, and those of checkpoints, if there
    are any, do not enter the digest. What is told of a plant is told where all robots have it.
    """
    topics, robots = Topics.of_run(n), range(1, n + 1)
    of = {robot: plant for plant in plants for robot in plant["robots"]}

    def of_kind(kind: str, codec: Codec, nodes: Iterable[int], counted: bool) -> Iterator[Channel]:
        for topic, shared_by in topics.each(kind, sorted(nodes)):
            first = of.get(shared_by[0])
            plant = first if all(of.get(node) is first for node in shared_by) else None
            yield Channel(topic, codec.kind.name, counted, _joints(plant, codec.kind))

    found = [*of_kind("sample", codecs.samples, range(n + 1), True)]
    found += of_kind("state", codecs.states, robots, True)
    of_agents = {"agent_state": robots, "measurement": measuring}
    for kind, codec in codecs.of_agents.items():
        found += of_kind(kind, codec, of_agents[kind], True)
    found += of_kind("link_event", codecs.link_events, faulty, False)
    if checkpoints:
        found += [
            Channel(topic, CHECKPOINT.name, counted=False)
            for topic in topics.all_of("checkpoint", robots)
        ]
    return found


def _joints(plant: Mapping[str, Any] | None, kind: MessageType) -> dict[str, str]:
    """Return a channel's metadata: the joints' names, each vector's units, FMU and drive."""
    if plant is None:
        return {}
    units = [joint["unit"] for joint in plant["joints"]]
    metadata = {"joints": json.dumps([joint["name"] for joint in plant["joints"]])}
    for name, of in kind.fields.items():
        by_joint = [field_unit(name, of, unit) for unit in units]
        metadata[f"unit.{name}"] = json.dumps(by_joint if "m" in of.shape else of.unit or "")
    return metadata | {"fmu": plant["fmu"], "drive": plant["drive"]}


def schemas(used_by: Iterable[Channel], codecs: Codecs) -> list[Schema]:
    """Return the protobuf schemas of some channels, of messages that `codecs` code."""
    used = {channel.schema_name for channel in used_by}
    kinds: tuple[MessageType | BlobType, ...] = (*codecs.types, CHECKPOINT)
    return [Schema(kind.name, kind.descriptor()) for kind in kinds if kind.name in used]
