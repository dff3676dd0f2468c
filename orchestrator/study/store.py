"""A study's folder: rows that a crash at any time leaves whole.

    study.json          what the study is of; made first, by renaming
    journal.jsonl       a row a line, added and on the disk before the next point is begun
    rows-00001.parquet  rows that the journal had, once it was long; where pyarrow is installed
    recordings/         those that are kept, by key

One process writes, and holds the journal's lock. A line that was torn by a crash is cut off, and
its point is run again. A row that is in a part and in the journal too, as after a crash between the
two, counts once; of two rows with a key the later one holds.
"""

import json
import os
import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from nrs_cosim.bus.errors import InputError, MissingExtraError, RunError
from nrs_cosim.orchestrator.study.rows import COLUMNS, StudyRow

ROLLED = 5_000
"""Rows of the journal that become a part."""
FORMAT = 1
PARTS: Mapping[str, Mapping[str, type]] = {
    "scenarios": {"name": str, "text": str, "folder": str},
    "axes": {"keys": list, "values": list},
}
"""What study.json has, and of what each is."""
ROW: Mapping[str, type] = {"key": str, "point": str, "scenario": str, "seed": int, "status": str}
"""What no row is without."""


class StudyStore:
    """The folder of a study; a context manager."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._journal = folder / "journal.jsonl"
        self._file: Any = None

    @property
    def journal(self) -> Path:
        """The file that its one writer holds the lock of."""
        return self._journal

    @property
    def recordings(self) -> Path:
        """Where recordings are kept."""
        return self.folder / "recordings"

    def definition(self) -> dict[str, Any]:
        """Return what the study is of; `InputError` where the folder holds no study."""
        try:
            found: dict[str, Any] = json.loads((self.folder / "study.json").read_bytes())
        except (FileNotFoundError, NotADirectoryError):
            raise InputError(f"{self.folder}: is no study: it has no study.json") from None
        except (OSError, ValueError) as error:
            raise InputError(f"{self.folder}/study.json: cannot be read: {error}") from None
        if not isinstance(found, dict) or found.get("format") != FORMAT:
            raise InputError(f"{self.folder}/study.json: is of no format that this version knows")
        if not all(
            isinstance(found.get(part), list) and all(_has(one, kinds) for one in found[part])
            for part, kinds in PARTS.items()
        ):
            raise InputError(f"{self.folder}/study.json: is damaged: it lacks what a study is of")
        return found

    @property
    def exists(self) -> bool:
        """Whether a study is there."""
        return (self.folder / "study.json").exists()

    def define(self, definition: Mapping[str, Any]) -> None:
        """Write what the study is of, in the place of what was there."""
        part = self.folder / "study.json.part"
        with part.open("w", encoding="utf-8") as file:
            json.dump({"format": FORMAT, **definition}, file, indent=1)
            file.flush()
            os.fsync(file.fileno())
        part.replace(self.folder / "study.json")

    def open(self) -> "StudyStore":
        """Begin to write: what a crash has torn is cut off."""
        data = self._journal.read_bytes() if self._journal.exists() else b""
        whole = data.rfind(b"\n") + 1
        self._file = self._journal.open("ab", buffering=0)
        if whole < len(data):
            os.truncate(self._journal, whole)
        return self

    def __enter__(self) -> "StudyStore":
        return self.open()

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def put(self, row: StudyRow) -> None:
        """Add a row; it is on the disk when this returns."""
        left = memoryview(json.dumps(row.as_json()).encode() + b"\n")
        try:
            while left:
                left = left[self._file.write(left) :]
            os.fsync(self._file.fileno())
        except OSError as error:
            raise RunError(
                f"{self._journal}: cannot be written: {error.strerror}; the rows before are kept"
            ) from None

    def roll(self, least: int = ROLLED) -> None:
        """Make a part of the journal, if it is that long and pyarrow is installed."""
        rows = list(self._journalled())
        if len(rows) < least:
            return
        try:
            from nrs_cosim.recordings.export.row_parts import write_part  # noqa: PLC0415 (an extra)
        except ImportError:
            return
        last = max((int(path.stem.partition("-")[2]) for path in self.parts), default=0)
        write_part(self.folder / f"rows-{last + 1:05d}.parquet", COLUMNS, rows)
        os.ftruncate(self._file.fileno(), 0)
        os.fsync(self._file.fileno())

    @property
    def parts(self) -> list[Path]:
        """The Parquet files, the oldest first."""
        return sorted(self.folder.glob("rows-[0-9][0-9][0-9][0-9][0-9].parquet"))

    def columns(self, *only: str) -> dict[str, list[Any]]:
        """Return columns, all or some, of one row a key; rows as they came."""
        names = [name for name in COLUMNS if not only or name in {*only, "key"}]
        found: dict[str, list[Any]] = {name: [] for name in names}
        if self.parts:
            try:
                from nrs_cosim.recordings.export.row_parts import (  # noqa: PLC0415 (an extra)
                    read_parts,
                )

                found = read_parts(self.parts, COLUMNS, names)
            except ImportError:
                raise MissingExtraError(
                    f"{self.folder}: its rows need pyarrow", "analysis"
                ) from None
            except (ValueError, KeyError, OSError) as error:  # Arrow's are such too
                raise InputError(f"{self.folder}/rows-*.parquet: cannot be read: {error}") from None
        for row in self._journalled():
            for name in names:
                found[name].append(row.get(name))
        last = {key: place for place, key in enumerate(found["key"])}
        if len(last) < len(found["key"]):
            kept = sorted(last.values())
            found = {name: [column[place] for place in kept] for name, column in found.items()}
        return found

    def rows(self) -> Iterator[StudyRow]:
        """Yield the rows, one a key."""
        found = self.columns()
        for values in zip(*found.values(), strict=True):
            yield StudyRow.of(dict(zip(found, values, strict=True)))

    def statuses(self) -> dict[str, str]:
        """Return the status of each row, by key."""
        found = self.columns("status")
        return dict(zip(found["key"], found["status"], strict=True))

    def _journalled(self) -> Iterator[dict[str, Any]]:
        """Yield the rows of the journal; a last line that is torn is none."""
        if not self._journal.exists():
            return
        *lines, _torn = self._journal.read_bytes().split(b"\n")
        for number, line in enumerate(lines, 1):
            try:
                row = json.loads(line)
            except ValueError:
                row = None
            if not _has(row, ROW):
                raise InputError(f"{self._journal}: line {number} is no row")
            yield row


def _has(found: Any, kinds: Mapping[str, type]) -> bool:
    """Return whether it is a table with keys of such types."""
    return isinstance(found, dict) and all(type(found.get(key)) is of for key, of in kinds.items())


def rerun_line(store: StudyStore, key: str) -> str:
    """Return the line that runs a row's point again, with a recording."""
    return shlex.join(["nrs", "study", "run", str(store.folder), key[:12]])
