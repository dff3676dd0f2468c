"""Native code arranges a chunk to the same bytes of the whole file as NumPy, the oracle."""

import numpy as np
import pytest

from nrs_cosim.orchestrator.engine.native import arranging as engine_arranging
from nrs_cosim.orchestrator.engine.native.arranging import load_arranging
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.recordings.mcap.arrangement import by_numpy
from nrs_cosim.recordings.mcap.container import Channel, Schema
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from tests.cases import cases

TOPICS = ["b", "/a", "/a/10", "/a/2", "é", "/a/1"]
"""In no order, of several lengths, one with a character of two bytes."""


def file_of(path, arranging, ticks, compression="zstd"):
    """Return the bytes of a recording of ticks, some to a chunk; the last topic is not counted."""
    with Writer(
        path,
        version="1",
        channels=[Channel(topic, "s", counted=topic != TOPICS[-1]) for topic in TOPICS],
        schemas=[Schema("s", b"")],
        metadata={},
        attachments={},
        compression=compression,
        chunk_bytes=1500,
        chunk_seconds=1e9,
        arranging=arranging,
    ) as writer:
        for tick in ticks:
            writer.write(tick)
        writer.finish("completed")
    return path.read_bytes()


def ticks_of(rng, count):
    """Return ticks of messages that share times, topics, sequences and beginnings of their data."""
    ticks = []
    for k in range(count):
        n = int(rng.integers(1, 60))
        times, on = rng.integers(3 * k, 3 * k + 3, n).tolist(), rng.integers(len(TOPICS), size=n)
        data = [b"abab"[: rng.integers(5)] + rng.bytes(rng.integers(3)) for _ in range(n)]
        sequences = rng.integers(k, k + 2, n).tolist()
        ticks.append(list(zip(times, [TOPICS[at] for at in on], sequences, data, strict=True)))
    return ticks


@pytest.mark.parametrize("seed", cases(range(200), range(12)))
def test_native_code_arranges_messages_in_any_order_as_numpy_does(tmp_path, seed):
    assert load_arranging() is not by_numpy
    rng = np.random.default_rng(seed)
    ticks, compression = ticks_of(rng, 20), ("zstd", "lz4", "none")[seed % 3]
    native = file_of(tmp_path / "native.mcap", load_arranging(), ticks, compression)
    assert native == file_of(tmp_path / "numpy.mcap", by_numpy, ticks, compression)
    with Reader(tmp_path / "native.mcap", verify=True) as reader:
        assert not reader.damage
        read = [message for batch in reader.batches() for message in batch]
        assert read == [message for tick in ticks for message in sorted(tick)]


EDGES = {
    "one message without bytes": [[(0, "b", 0, b"")]],
    "extreme numbers": [[(0, "b", 2**32 - 1, b"x")], [(2**64 - 1, "b", 2**32 - 1, b"")]],
    "only what is not counted": [[(5, TOPICS[-1], 1, b"x")]],
    "descending": [[(t, topic, 1, b"x") for t in range(9, 0, -1) for topic in TOPICS]],
    "equal": [[(1, "b", 1, b"x")] * 5],
    "no message": [],
}


@pytest.mark.parametrize("case", EDGES)
def test_native_code_arranges_what_is_extreme_as_numpy_does(tmp_path, case):
    native = file_of(tmp_path / "native.mcap", load_arranging(), EDGES[case])
    assert native == file_of(tmp_path / "numpy.mcap", by_numpy, EDGES[case])


def test_numpy_arranges_where_nothing_can_be_compiled(monkeypatch):
    def refuse(*_):
        raise FmuError("no C compiler found")

    monkeypatch.setattr(engine_arranging, "build_library", refuse)
    assert load_arranging.__wrapped__() is by_numpy
