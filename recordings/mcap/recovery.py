"""A damaged recording made whole: a new one that holds everything that can be vouched for.

Every chunk that is whole and in order is kept, and a chunk holds whole ticks. What is missing is
missing, also in the middle; `damage`, in the new metadata "nrs.recovered", says where. The messages
are the same bytes, so the digest is that of the reader.
"""

import json
from os import PathLike

from nrs_cosim.recordings.mcap.copy import copy_of, ending
from nrs_cosim.recordings.mcap.reader import Reader

RECOVERED = "nrs.recovered"
"""The metadata record of a recovered recording: file, status, reason, and damage, a JSON list."""


def recover(reader: Reader, path: str | PathLike[str]) -> None:
    """Write what a recording still holds as a new one, which ends as `ending` says.

    Raises `UncreatableError` when there is a file already, or none can be made, `UnreadableError`
    when no tick is left.
    """
    reader.expect_ticks("recover")
    metadata = {"file": str(reader.path), "status": reader.status, "reason": reader.reason}
    metadata["damage"] = json.dumps(reader.damage)
    with copy_of(reader, path, {RECOVERED: metadata}) as writer:
        for chunk in reader.batches():
            writer.write(chunk)
        writer.finish(*ending(reader))
