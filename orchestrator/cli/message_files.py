"""The `.proto` files of what no algorithm declares: samples, states, measurements, link events."""

from pathlib import Path

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.messages import STANDING_TYPES
from nrs_cosim.bus.proto_text import proto_files
from nrs_cosim.orchestrator.cli.output_paths import expect_folder, make_folder


def write_messages(folder: Path) -> list[Path]:
    """Write them into a folder, by the paths that they have in recordings; return these."""
    written = []
    for name, text in proto_files(kind.descriptor() for kind in STANDING_TYPES).items():
        path = folder / name
        expect_folder(path.parent)
        make_folder(path)
        try:
            path.write_text(text, "utf-8")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from None
        written.append(path)
    return written
