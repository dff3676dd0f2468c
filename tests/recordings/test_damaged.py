"""Files damaged in hundreds of ways, the same on every machine: an answer or a clear error.

The oracle is the file before it was damaged: whatever is given must be what was said there, at the
same topic, time and sequence.
"""

import csv
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.keys import kind_of
from nrs_cosim.bus.messages import SAMPLE, STATE, Codec
from nrs_cosim.orchestrator.engine.summary import describe, experiment_of, measure
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.export.tables import SAMPLES, STATES
from nrs_cosim.recordings.mcap.container import Message
from nrs_cosim.recordings.mcap.copy import recover
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.recordings.made_up_runs import recorded
from tests.topics import node_of

CASES = cases(1200, 480)
EIGHT = (bytes(8), b"\xff" * 8, bytes(7) + b"\x7f", bytes(3) + b"\x40" + bytes(4))
N, M, TICKS = 3, 2, 6


@pytest.fixture(scope="module")
def originals(
    tmp_path_factory: pytest.TempPathFactory,
) -> list[tuple[bytes, dict[tuple[int, str, int], set[bytes]], dict[str, dict]]]:
    """Small runs: their bytes, their messages by place, the rows of their tables."""
    folder, made = tmp_path_factory.mktemp("originals"), []
    for compression in ("zstd", "lz4", "none"):
        path = folder / f"{compression}.mcap"
        options = {"compression": compression, "chunk_bytes": 1500, "faulty": [2]}
        messages = recorded(path, n=N, m=M, ticks=TICKS, **options)
        whole = path.read_bytes()
        made.append((whole, by_place(messages), tables(messages)))
        unfinished = whole[: whole.rindex(b"nrs.end", 0, whole.rindex(b"nrs.end")) - 13]
        made.append((unfinished, *made[-1][1:]))
    return made


def by_place(messages: list[Message]) -> dict[tuple[int, str, int], set[bytes]]:
    places: dict[tuple[int, str, int], set[bytes]] = {}
    for time_ns, topic, k, data in messages:
        places.setdefault((time_ns, topic, k), set()).add(data)
    return places


def tables(messages: list[Message]) -> dict[str, dict]:
    """By table, time and robot, the numbers of a row."""
    found: dict[str, dict] = {"samples": {}, "states": {}}
    for time_ns, topic, _, data in messages:
        kind, node = kind_of(topic), node_of(topic)
        if kind != "link_event":
            codec = Codec(SAMPLE if kind == "sample" else STATE, Sizes(M))
            (row,) = codec.decode([data])
            numbers = np.concatenate([row[name] for name in codec.kind.fields])
            found[f"{kind}s"][time_ns / 1e9, node] = numbers.tolist()
    return found


@dataclass(frozen=True)
class Edit:
    """One damage: `length` bytes at `at` flipped, overwritten, cut, duplicated or moved."""

    kind: str
    at: int
    length: int
    to: int
    filling: bytes

    def on(self, data: bytes) -> bytes:
        """The bytes after it."""
        at, to = min(self.at, len(data)), min(self.to, len(data))
        before, some, after = data[:at], data[at : at + self.length], data[at + self.length :]
        if self.kind == "flip":
            return before + bytes([data[at] ^ 1 << to % 8]) + data[at + 1 :] if some else data
        if self.kind == "set":
            return before + self.filling + data[at + len(self.filling) :]
        if self.kind == "move":
            rest = before + after
            return rest[:to] + some + rest[to:]
        middle = {"cut": b"", "twice": some + some, "insert": self.filling + some}
        return before + middle[self.kind] + after if self.kind in middle else before


def edits(whole: bytes) -> st.SearchStrategy[list[Edit]]:
    """One to three of them, most behind the head, some of whole chunks."""
    end = len(whole)
    everywhere, behind = st.integers(0, end), st.integers(whole.index(b"nrs.begin"), end)
    places = everywhere | behind | behind | behind
    kinds = st.sampled_from(["flip", "set", "cut", "end", "twice", "insert", "move"])
    lengths = st.integers(1, 16) | everywhere
    filling = st.sampled_from(EIGHT) | st.binary(min_size=1, max_size=40)
    one = st.builds(Edit, kinds, places, lengths, places, filling)
    bounds = st.sampled_from(chunks(whole))
    some = st.tuples(st.sampled_from(["cut", "twice", "move"]), bounds, bounds, bounds).map(
        lambda drawn: Edit(drawn[0], min(drawn[1:3]), abs(drawn[1] - drawn[2]), drawn[3], b"")
    )
    return st.lists(one | one | some, min_size=1, max_size=3)


def chunks(whole: bytes) -> list[int]:
    """Where each chunk begins."""
    found, at = [], 8
    while at < len(whole) - 8:
        found += [at] if whole[at] == Opcode.CHUNK else []
        at += 9 + int.from_bytes(whole[at + 1 : at + 9], "little")
    return found


def answer(read: Callable[[], object]) -> bool:
    """Whether a reader gave an answer; if not, it must have said so, and either within a second."""
    start = time.process_time()
    try:
        read()
    except InputError:
        return False
    else:
        return True
    finally:
        assert time.process_time() - start < 1


@pytest.mark.parametrize("which", cases(range(6), range(1, 2)))
def test_no_damage_makes_a_wrong_value_or_another_error(originals, tmp_path, which) -> None:
    whole, places, rows = originals[which]
    path, new, answers = tmp_path / "a.mcap", tmp_path / "new.mcap", []
    left: list[Message] = []

    def check_messages(path: Path) -> None:
        with Reader(path) as reader:
            left[:] = found = list(reader.messages())
            assert found == sorted(set(found))
            for time_ns, topic, k, data in found:
                assert data in places[time_ns, topic, k]

    def check_recording() -> None:
        with Recording(path) as recording:
            for table, found in recording.chunks([SAMPLES, STATES]):
                for row in found:
                    vectors = np.concatenate([row[name] for name in found.dtype.names[4:]])
                    assert rows[table.name][row["t"], row["robot"]] == vectors.tolist()
            assert len(recording.states(start=0.2, end=0.3)) <= 2 * N
            recording.samples([0])

    def check_info() -> None:
        with Reader(path) as reader:
            result = describe(reader, experiment_of(reader))
            assert json.loads(json.dumps(result))["ticks"] <= TICKS
            assert result["messages"] <= sum(map(len, places.values()))
            measure(reader, experiment_of(reader))

    def check_export() -> None:
        with Reader(path) as reader:
            for table in export(reader, tmp_path / "tables")[:2]:
                with table.open(newline="") as file:
                    header, *lines = csv.reader(file)
                first = header.index("t")
                for line in lines:
                    t, robot, *numbers = map(float, line[first:])
                    assert rows[table.stem][t, int(robot)] == numbers

    def check_recover() -> None:
        new.unlink(missing_ok=True)
        with Reader(path) as reader:
            recover(reader, new)
            kept = list(reader.messages())
        with Reader(new, verify=True) as again:
            assert again.damage == []
            assert list(again.messages()) == kept
            assert again.status == "completed" or again.reason.startswith("recovered from")

    @settings(
        max_examples=CASES // 6,
        derandomize=True,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(edits(whole))
    def judge(made: list[Edit]) -> None:
        left.clear()
        path.write_bytes(reduce(lambda data, edit: edit.on(data), made, whole))
        answers.append(answer(lambda: check_messages(path)))
        for check in (check_recording, check_info):
            assert answer(check) == answers[-1]
        for check in (check_export, check_recover):  # of nothing there is no table and no copy
            assert answer(check) == (answers[-1] and bool(left))

    judge()
    assert len(answers) >= CASES // 6
    assert sum(answers) > len(answers) // 4
