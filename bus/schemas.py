"""A message type read from a protobuf schema, as any file may hold one.

It is the inverse of `MessageType.descriptor`. Protobuf knows no shapes: those of arrays come from
beside the schema, and an array of which nothing is known has m numbers. Whatever a run never
writes (another type, an optional field, a gap in the numbers) is an error that names the field.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.message import DecodeError

from nrs_cosim.bus.descriptors import protobuf_type
from nrs_cosim.bus.fields import Field, Fields, wrong_fields
from nrs_cosim.bus.messages import OPENING, Count, MessageType
from nrs_cosim.bus.text import quoted

MOST_FIELDS = 1000
_KINDS: Mapping[int, Field | Count] = {
    protobuf_type(kind): kind for kind in (Field(()), Count(), Count(bits=64))
}


class SchemaError(Exception):
    """Why a schema is none of a run's; the text names the message type and the field."""


def message_type(name: str, descriptor: bytes, known: Fields) -> MessageType:
    """Return the type of a full name in a serialised `FileDescriptorSet`; `SchemaError`.

    `known` has the shapes, units and meanings of its fields, of those that any is known of.
    """
    try:
        files = FileDescriptorSet.FromString(descriptor)
    except DecodeError:
        raise SchemaError(f"{quoted(name)}: is no protobuf FileDescriptorSet") from None
    found = next(_messages(files, name), None)
    if found is None:
        raise SchemaError(f"{quoted(name)}: is not described in its schema")
    file, index = found
    message = file.message_type[index]
    if len(message.field) > MOST_FIELDS:
        raise SchemaError(f"{quoted(name)}: has {len(message.field)} fields, over {MOST_FIELDS}")
    comments = dict(_comments(file, index))
    entries: dict[str, Field | Count] = {}
    ordered = sorted(enumerate(message.field), key=lambda entry: entry[1].number)
    for number, (place, declared) in enumerate(ordered, 1):
        entry = _entry(declared, number, known)
        if entry is None or declared.name in entries:
            raise SchemaError(f"{quoted(name)}: field {quoted(declared.name)}: no run writes such")
        doc = entry.doc or comments.get(place, "")
        entries[declared.name] = replace(entry, doc=doc)
    opening = [(field, entries.pop(field, None)) for field in OPENING]
    for (field, entry), expected in zip(opening, OPENING.values(), strict=True):
        if not isinstance(entry, Count) or entry.bits != expected.bits:
            raise SchemaError(f"{quoted(name)}: field {field}: missing, or not as every message's")
    if [declared.name for _, declared in ordered[: len(OPENING)]] != [*OPENING]:
        raise SchemaError(f"{quoted(name)}: does not begin with {', '.join(OPENING)}")
    fields = {field: entry for field, entry in entries.items() if isinstance(entry, Field)}
    if wrong := next(wrong_fields(fields), None):
        raise SchemaError(f"{quoted(name)}: field {wrong}")
    if any(isinstance(entry, Count) and entry.bits > 32 for entry in entries.values()):
        raise SchemaError(f"{quoted(name)}: has a further number of 64 bits; no run writes such")
    return MessageType(name, entries)


def _messages(files: FileDescriptorSet, name: str) -> Iterator[tuple[FileDescriptorProto, int]]:
    for file in files.file:
        for index, message in enumerate(file.message_type):
            if ".".join(filter(None, (file.package, message.name))) == name:
                yield file, index


def _entry(declared: FieldDescriptorProto, number: int, known: Fields) -> Field | Count | None:
    """Return what a field is; None for one that no run writes."""
    kind = _KINDS.get(declared.type) if declared.HasField("type") else None
    if kind is None or declared.number != number:
        return None
    if declared.label == FieldDescriptorProto.LABEL_OPTIONAL:
        of = known.get(declared.name, Field(()))
        is_scalar = declared.proto3_optional and not of.shape
        return (of if isinstance(kind, Field) else kind) if is_scalar else None
    of = known.get(declared.name, Field())
    unpacked = declared.options.HasField("packed") and not declared.options.packed
    is_array = declared.label == FieldDescriptorProto.LABEL_REPEATED and not unpacked
    return of if is_array and isinstance(kind, Field) and of.shape else None


def _comments(file: FileDescriptorProto, index: int) -> Iterator[tuple[int, str]]:
    """Yield of the fields of a message, by their places, what is said of each."""
    field = DescriptorProto.FIELD_FIELD_NUMBER
    path = [FileDescriptorProto.MESSAGE_TYPE_FIELD_NUMBER, index, field]
    for location in file.source_code_info.location:
        if len(location.path) == len(path) + 1 and location.path[:-1] == path:
            yield location.path[-1], location.leading_comments.strip()
