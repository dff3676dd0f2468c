"""A new recording from another one: its head, and what is added; the other is not touched."""

from collections.abc import Iterable, Mapping
from os import PathLike
from pathlib import Path

from nrs_cosim.recordings.errors import UncreatableError
from nrs_cosim.recordings.mcap.container import END_FIELDS, PART, Channel, Closing, Schema
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer


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
        extra = {name: said for name, said in reader.end.items() if name not in END_FIELDS}
        return reader.status, reader.reason, extra
    what = "; ".join(filter(None, (reader.status, reader.reason, *reader.damage)))
    whole = reader.end.get(PART) or reader.end.get("digest", "")
    return "failed", f"recovered from {reader.path}: {what}", {PART: whole}
