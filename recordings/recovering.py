"""A damaged recording made whole: a new one that holds everything that can be vouched for.

Every chunk that is whole and in order is kept, and a chunk holds whole ticks. What is missing is
missing, also in the middle; `damage`, in the new metadata "nrs.recovered", says where. The messages
are the same bytes, so the digest is that of the reader.

Where all messages are here the run ended as it says. Else the new recording is "failed", whatever
was said of the run: its reason begins with "recovered from".
"""

import json
from os import PathLike
from pathlib import Path

from recordings.container import END_FIELDS, Closing
from recordings.errors import UncreatableError
from recordings.reading import Reader
from recordings.writing import Writer

RECOVERED = "nrs.recovered"
"""The metadata record of a recovered recording: file, status, reason, and damage, a JSON list."""


def recover(reader: Reader, path: str | PathLike[str]) -> tuple[Closing, str]:
    """Write what a recording still holds as a new one; return its status and reason.

    Raises `UncreatableError` when there is a file already, or none can be made.
    """
    if Path(path).exists():
        raise UncreatableError(f"{path}: is there already; give the name of a new file")
    told = {"file": str(reader.path), "status": reader.status, "reason": reader.reason}
    told["damage"] = json.dumps(reader.damage)
    status, reason, extra = _ending(reader)
    with Writer(
        path,
        version=reader.library.removeprefix("nrs-cosim "),
        channels=reader.channels,
        schemas=reader.schemas,
        metadata={**reader.metadata, RECOVERED: told},
        attachments=reader.attachments,
        chunk_seconds=float("inf"),
    ) as writer:
        for chunk in reader.batches():
            writer.write(chunk)
        writer.finish(status, reason, extra)
    return status, reason


def _ending(reader: Reader) -> tuple[Closing, str, dict[str, str]]:
    """How the new recording ends: its status, the reason, and what else was said at the end."""
    here = (str(reader.message_count), reader.digest)
    if reader.status != "unfinished" and here == (reader.end["messages"], reader.end["digest"]):
        extra = {name: said for name, said in reader.end.items() if name not in END_FIELDS}
        return reader.status, reader.reason, extra
    what = "; ".join(filter(None, (reader.status, reader.reason, *reader.damage)))
    return "failed", f"recovered from {reader.path}: {what}", {}
