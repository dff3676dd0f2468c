"""The protobuf descriptor of a message type, which travels with every recording."""

from collections.abc import Mapping

from google.protobuf.descriptor_pb2 import (
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)

from nrs_cosim.bus.fields import Field
from nrs_cosim.bus.messages import COMMENTS, DATA, BlobType, Count, MessageType

_MESSAGE_TYPE, _FIELD = 4, 2
"""Of FileDescriptorProto and DescriptorProto, for the paths of comments."""


def of_message(kind: MessageType) -> bytes:
    """Return the serialised `FileDescriptorSet` that describes a type."""
    file = FileDescriptorProto(
        name=f"{kind.name.replace('.', '/')}.proto",
        package=kind.name.rpartition(".")[0],
        syntax="proto3",
    )
    message = file.message_type.add(name=kind.name.rpartition(".")[2])
    for number, name, entry in kind.numbered:
        declared = message.field.add(name=name, number=number, type=protobuf_type(entry))
        if isinstance(entry, Field) and entry.shape:
            declared.label = FieldDescriptorProto.LABEL_REPEATED
            continue
        declared.label = FieldDescriptorProto.LABEL_OPTIONAL
        declared.proto3_optional, declared.oneof_index = True, len(message.oneof_decl)
        message.oneof_decl.add(name=f"_{name}")
    _comment(file, {name: entry.doc for _, name, entry in kind.numbered})
    return FileDescriptorSet(file=[file]).SerializeToString()


def of_blob(kind: BlobType) -> bytes:
    """Return that of a type of any size."""
    files = FileDescriptorSet.FromString(of_message(MessageType(kind.name, {})))
    files.file[0].message_type[0].field.add(
        name="data",
        number=DATA,
        type=FieldDescriptorProto.TYPE_BYTES,
        label=FieldDescriptorProto.LABEL_OPTIONAL,
    )
    files.file[0].ClearField("source_code_info")
    _comment(files.file[0], COMMENTS)
    return files.SerializeToString()


def protobuf_type(entry: Field | Count) -> FieldDescriptorProto.Type.ValueType:
    """Return what an entry is in a descriptor."""
    if isinstance(entry, Field):
        return FieldDescriptorProto.TYPE_DOUBLE
    wide = entry.bits > 32
    return FieldDescriptorProto.TYPE_FIXED64 if wide else FieldDescriptorProto.TYPE_FIXED32


def _comment(file: FileDescriptorProto, comments: Mapping[str, str]) -> None:
    """Put comments on the fields of a file's only message, as protoc keeps them."""
    for number, declared in enumerate(file.message_type[0].field):
        file.source_code_info.location.add(
            path=[_MESSAGE_TYPE, 0, _FIELD, number],
            span=[number, 0, 0],
            leading_comments=f" {comments[declared.name]}\n",
        )
