"""Message types as `.proto` files, which a compiler of protobuf takes for any language."""

from collections.abc import Iterable, Iterator

from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

_WORDS = {
    FieldDescriptorProto.TYPE_DOUBLE: "double",
    FieldDescriptorProto.TYPE_FIXED32: "fixed32",
    FieldDescriptorProto.TYPE_FIXED64: "fixed64",
    FieldDescriptorProto.TYPE_BYTES: "bytes",
}


def proto_files(descriptors: Iterable[bytes]) -> dict[str, str]:
    """Return the text of each file of serialised `FileDescriptorSet`s of a run, by its path."""
    return {
        file.name: "\n".join(_lines(file)) + "\n"
        for descriptor in descriptors
        for file in FileDescriptorSet.FromString(descriptor).file
    }


def _lines(file: FileDescriptorProto) -> Iterator[str]:
    (message,) = file.message_type
    said = {
        location.path[-1]: location.leading_comments for location in file.source_code_info.location
    }
    yield 'syntax = "proto3";'
    yield ""
    yield f"package {file.package};"
    yield ""
    yield f"message {message.name} {{"
    for number, field in enumerate(message.field):
        yield f"  //{said[number].rstrip()}"
        label = "repeated " if field.label == FieldDescriptorProto.LABEL_REPEATED else ""
        label = "optional " if field.proto3_optional else label
        yield f"  {label}{_WORDS[field.type]} {field.name} = {field.number};"
    yield "}"
