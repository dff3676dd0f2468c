"""A new recording from another one: its head, and what is added; the other is not touched."""

import json
from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path

from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.mcap.container import END_FIELDS, PART, Channel, Closing, Schema
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from nrs_cosim.recordings.metadata import LINKS, MEASURED, THEORY


def copy_of(
    reader: Reader,
    path: str | PathLike[str],
    metadata: Mapping[str, Mapping[str, str]],
    channels: Iterable[Channel] = (),
    schemas: Iterable[Schema] = (),
) -> Writer:
    """Return the writer of a new recording with the head of another, and more of each kind.

    Raises `UncreatableError` when there is a file already, or none can be made.
    """
    if Path(path).exists():
        raise UncreatableError(f"{path}: is there already; give the name of a new file")
    return Writer(
        path,
        version=reader.library.removeprefix("nrs-cosim "),
        channels=[*reader.channels, *channels],
        schemas=[*reader.schemas, *schemas],
        metadata={**reader.metadata, **metadata},
        attachments=reader.attachments,
        chunk_seconds=float("inf"),
    )


def ending(reader: Reader) -> tuple[Closing, str, dict[str, str]]:
    """Return how a copy of all that is here ends: status, reason, and what else was said.

    Where all messages are here, as the run did. Else it is "failed", whatever was said of the run,
    its reason begins with "recovered from", and it says that its digest is a part's.
    """
    if reader.status != "unfinished" and reader.digest:
        anew = {MEASURED, LINKS, THEORY} if reader.computed else set()
        left = END_FIELDS | anew
        extra = {name: said for name, said in reader.end.items() if name not in left}
        return reader.status, reader.reason, extra
    what = "; ".join(filter(None, (reader.status, reader.reason, *reader.damage)))
    whole = reader.end.get(PART) or reader.end.get("digest", "")
    return "failed", f"recovered from {Path(reader.path).name}: {what}", {PART: whole}


RECOVERED = "nrs.recovered"
"""The metadata record of a recovered recording: file, status, reason, and damage, a JSON list."""


def recover(reader: Reader, path: str | PathLike[str]) -> None:
    """Write what a recording still holds as a new one, which ends as `ending` says.

    Every chunk that is whole and in order is kept, and a chunk holds whole ticks. What is missing
    is missing, also in the middle; `damage`, in the new metadata, says where. The messages are the
    same bytes, so the digest is that of the reader.

    Raises `UncreatableError` when there is a file already, or none can be made, `UnreadableError`
    when no tick is left.
    """
    reader.expect_ticks("recover")
    metadata = {"file": Path(reader.path).name, "status": reader.status, "reason": reader.reason}
    metadata["damage"] = json.dumps(reader.damage)
    with copy_of(reader, path, {RECOVERED: metadata}) as writer:
        for chunk in reader.batches():
            writer.write(chunk)
        writer.finish(*ending(reader))
