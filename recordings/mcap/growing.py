"""A recording while its run goes on: its head, then each chunk, once it is in the file.

The writer puts a chunk behind the last one in one piece. What ends inside a record, or is not as
its checksum says, is not there yet.
"""

from collections.abc import Iterator
from contextlib import suppress

from mcap.opcode import Opcode

from nrs_cosim.recordings.mcap.columns import Columns
from nrs_cosim.recordings.mcap.container import DamageError
from nrs_cosim.recordings.mcap.layout import RecordFile
from nrs_cosim.recordings.mcap.reader import Reader


class GrowingReader(Reader):
    """The recording at `path`, of which nothing behind the head has been read."""

    _read_to: int
    is_whole = False
    """Whether its writer has closed it, and all of it was read."""

    def grown(self) -> Iterator[Columns]:
        """Yield the messages that have come, a chunk at a time, each once."""
        self._records = RecordFile(self._file)  # as large as it is now
        with suppress(DamageError):
            for kind, span in () if self.is_whole else self._records.walk(*self._unread):
                found = self._columns(span) if kind == Opcode.CHUNK else None
                self._read_to = span.offset + span.length
                if found is not None:
                    yield found
                elif kind == Opcode.DATA_END:
                    self.is_whole = True
                    return

    @property
    def _unread(self) -> tuple[int, int]:
        return self._read_to, self._records.size

    def _read_rest(self, after_head: int, verify: bool) -> None:
        """Read nothing yet."""
        del verify
        self._read_to = after_head
        self._chunks, self.end, self.ending = [], {}, None
        self.digest_here, self.ticks, self.message_count = "", 0, 0
        self.status, self.reason = "unfinished", "it is being written"
