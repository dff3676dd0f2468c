"""A recording is read by the schemas in it, not by what this version of the program would write.

The metadata record `nrs.fields` says of each field of a message type beside the standing ones what
protobuf does not: shape, unit, which quantity of the target it stands for. Files come from
strangers: what no run writes is refused by name, before anything is made of it.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from math import prod
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Json, TypeAdapter, ValidationError
from pydantic import Field as Limits

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import MOST_NUMBERS, Field, Sizes, wrong_fields
from nrs_cosim.bus.messages import LINK_EVENT, SAMPLE, STATE, Codec, MessageType
from nrs_cosim.bus.schemas import SchemaError, message_type
from nrs_cosim.bus.text import quoted
from nrs_cosim.bus.topics import Topics
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import RUN, About

FIELDS = "nrs.fields"
"""The metadata record of declared fields; there is none where all types are standing ones."""
IN_DEGREE = "in_degree"
"""Its key for the largest number of in-neighbours; the others are `<message type>.<field>`."""

KINDS = ("sample", "state", "link_event", "agent_state", "measurement")
"""Of messages that are tables."""
STANDING: Mapping[str, MessageType] = {"sample": SAMPLE, "state": STATE, "link_event": LINK_EVENT}
_Axis = Annotated[int, Limits(ge=1, le=MOST_NUMBERS)] | Literal["m", "n", "in_degree"]


class _FieldRecord(BaseModel):
    """What is said of a field; keys that are not known are a later version's."""

    model_config = ConfigDict(frozen=True, extra="ignore", defer_build=True)

    shape: tuple[_Axis, ...]
    truth: str | None = None
    unit: str | None = None
    doc: str = ""


_FIELD: TypeAdapter[_FieldRecord] = TypeAdapter(Json[_FieldRecord])
_DEGREE: TypeAdapter[int] = TypeAdapter(
    Annotated[int, Limits(ge=1, le=MOST_NUMBERS)], config=ConfigDict(defer_build=True)
)


def fields_record(codecs: Codecs) -> dict[str, dict[str, str]]:
    """Return the metadata record of a run's declared fields, by its name; empty without any."""
    found = {
        f"{kind.name}.{name}": json.dumps(
            {"shape": field.shape, "truth": field.truth, "unit": field.unit, "doc": field.doc}
        )
        for kind in codecs.types
        if kind.name not in {standing.name for standing in STANDING.values()}
        for name, field in kind.fields.items()
    }
    degree = {IN_DEGREE: str(codecs.samples.sizes.in_degree)}
    return {FIELDS: found | degree} if found else {}


@dataclass(frozen=True, slots=True)
class RecordedTypes:
    """What codes the messages of a recording, by their kinds: `KINDS`."""

    codecs: Mapping[str, Codec]
    """Without those of `Codecs.of_agents` that there are none of."""
    channels: Mapping[str, frozenset[int]]
    """The numbers of each kind's channels."""


def about(reader: Reader) -> About:
    """Return what a recording says of its run; `UnreadableError` when it says nothing of one."""
    if reader.about is None:
        raise UnreadableError(f"{reader.path}: holds no run; give a recording of `nrs run`")
    return reader.about


def recorded_types(reader: Reader) -> RecordedTypes:
    """Return the message types of a recording of a run, as its schemas have them.

    Raises `UnreadableError` for schemas and fields that no run writes.
    """
    run = about(reader).run
    degree, fields = _fields(reader)
    sizes = Sizes(run.joints, run.robots, degree)
    numbers = {topic: number for number, topic in reader.topics.items()}
    of_run = Topics.among(numbers, run.robots)
    names = {channel.topic: channel.schema_name for channel in reader.channels}
    data = {schema.name: schema.data for schema in reader.schemas}
    codecs, channels = {}, {}
    for kind in KINDS:
        topics = [t for t in of_run.all_of(kind, range(run.robots + 1)) if t in numbers]
        channels[kind] = frozenset(numbers[topic] for topic in topics)
        used = sorted({names[topic] for topic in topics})
        if len(used) > 1:
            raise _wrong(reader, f"topics of kind {kind} have {len(used)} schemas, expected one")
        if used:
            codecs[kind] = _codec(reader, kind, used[0], data[used[0]], fields, sizes)
        elif kind in STANDING:
            codecs[kind] = Codec(STANDING[kind], sizes)
    return RecordedTypes(codecs, channels)


def _fields(reader: Reader) -> tuple[int, dict[str, dict[str, Field]]]:
    """Return the largest in-degree, and what is known of each message type's fields."""
    found: dict[str, dict[str, Field]] = {}
    degree = 1
    for key, text in reader.metadata.get(FIELDS, {}).items():
        try:
            if key == IN_DEGREE:
                degree = _DEGREE.validate_python(text)
                continue
            said = _FIELD.validate_python(text)
        except ValidationError as error:
            fault = error.errors(include_url=False, include_context=False)[0]
            place = ".".join(map(str, (key, *fault["loc"])))
            raise _wrong(reader, f"{FIELDS}: {place}: {fault['msg']}") from None
        kind, _, name = key.rpartition(".")
        field = Field(said.shape, truth=said.truth, unit=said.unit, doc=said.doc)
        if wrong := next(wrong_fields({name: field}), None):
            raise _wrong(reader, f"{FIELDS}: {quoted(kind)}: {wrong}")
        found.setdefault(kind, {})[name] = field
    return degree, found


def _codec(
    reader: Reader,
    kind: str,
    name: str,
    descriptor: bytes,
    fields: Mapping[str, Mapping[str, Field]],
    sizes: Sizes,
) -> Codec:
    try:
        found = message_type(name, descriptor, fields.get(name, {}))
    except SchemaError as error:
        raise _wrong(reader, f"schema {error}") from None
    for field, declared in found.fields.items():
        if (count := prod(declared.size(sizes))) > MOST_NUMBERS:
            raise _wrong(reader, f"schema {name}: {field}: would have {count} numbers")
    if lacks := _lacks(kind, found):
        raise _wrong(reader, f"schema {quoted(name)}: is of {kind}s, but has no {lacks}")
    return Codec(found, sizes)


def _lacks(kind: str, found: MessageType) -> str | None:
    """Return what a kind of message must have, and this type has not."""
    if kind == "state":
        shapes = {name: field.shape for name, field in found.fields.items()}
        return next((n for n, field in STATE.fields.items() if shapes.get(n) != field.shape), None)
    if kind == "link_event":
        if next(iter(found.entries), None) != "source":
            return "source in the first place"
        return next((name for name in LINK_EVENT.counts if name not in found.counts), None)
    return None


def _wrong(reader: Reader, what: str) -> UnreadableError:
    return UnreadableError(
        f"{reader.path}: {what}; it is not as a run wrote it: use another copy, or run the "
        "scenario again"
    )


def expect_joints(reader: Reader, types: RecordedTypes) -> None:
    """Raise `UnreadableError` where messages are not of as many joints as the run is said to have.

    It reads the first message, before anything is made of that many.
    """
    states = Topics.among(reader.topics.values(), about(reader).run.robots).of("state", 1)
    first = next(reader.columns([states]), None)
    expected = types.codecs["state"].size
    if first is not None and (size := int(first.stop[0] - first.start[0])) != expected:
        raise UnreadableError(
            f"{reader.path}: {RUN}: joints: is {about(reader).run.joints}, but a state of robot 1 "
            f"has {size} bytes"
        )


def declared_types(codecs: Codecs) -> dict[str, Codec]:
    """Return what codes the messages of a run, by their kinds."""
    found = {"sample": codecs.samples, "state": codecs.states, "link_event": codecs.link_events}
    return {**found, **codecs.of_agents}


def contents_of(codec: Codec | None) -> str:
    """Return what messages have beside the first three: names, and the shapes of arrays."""
    if codec is None:
        return "none"
    shapes = {name: field.shape for name, field in codec.kind.fields.items()}
    names = {name: shapes.get(name, ()) for name in codec.kind.entries}
    return ", ".join(
        f"{name} ({', '.join(map(str, shape))})" if shape else name for name, shape in names.items()
    )
