"""Two recordings side by side, however they are cut into chunks, against one message at a time."""

import json
from itertools import zip_longest

import numpy as np
import pytest

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.messages import STATE, Codec
from nrs_cosim.orchestrator.replay.diff import compare
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.mcap import writer as writer_module
from nrs_cosim.recordings.mcap.container import tail
from nrs_cosim.recordings.mcap.reader import Reader
from tests.cases import cases
from tests.command import nrs
from tests.recordings.made_up_runs import create, tick
from tests.topics import node_of

N, M, TICKS = 5, 2, 12
CODEC = Codec(STATE, Sizes(M))


def made(edit=lambda messages: messages):
    return [edit(sorted(tick(k, N, M))) for k in range(TICKS + 1)]


def put(path, ticks, chunk_bytes):
    with create(path, N, M, TICKS, (), chunk_bytes=chunk_bytes, chunk_seconds=1e9) as writer:
        for messages in ticks:
            writer.write(messages)
        writer.finish("completed")
    return path


def moved(messages):
    """Robot 3's velocities from tick 5 on are others."""
    return [
        (t, topic, k, shifted(data) if k >= 5 and topic == "/robot_3/state" else data)
        for t, topic, k, data in messages
    ]


def shifted(data):
    record = CODEC.decode([data]).copy()
    record["velocity"] += np.sin(record["time_ns"])
    return record.tobytes()


def lacking(messages):
    return [m for m in messages if (m[2], m[1]) != (7, "/robot_2/sample")]


def more(messages):
    """Robot 4 has another state in tick 4."""
    if messages[0][2] != 4:
        return messages
    *_, (time_ns, topic, k, data) = (m for m in messages if m[1] == "/robot_4/state")
    record = CODEC.decode([data]).copy()
    record["time_ns"] += 1
    return [*messages, (time_ns + 1, topic, k, record.tobytes())]


def ended(messages):
    return messages if messages[0][2] < 9 else []


EDITS = {"moved": moved, "lacking": lacking, "more": more, "ended": ended}


def first_of(a, b):
    """Tick and topic of the first message that one has and the other has not."""
    for one, other in zip_longest(*([m for t in of for m in t] for of in (a, b))):
        if one != other:
            return min(m for m in (one, other) if m)[1:3]
    return None


def distances_of(a, b):
    of_a, of_b = (
        {m[:2]: CODEC.decode([m[3]])[0] for t in ticks for m in t if m[1].endswith("state")}
        for ticks in (a, b)
    )
    found = {}
    for t, topic in sorted(of_a.keys() & of_b.keys()):
        for name in STATE.fields:
            one, other = of_a[t, topic][name], of_b[t, topic][name]
            apart = float(np.sqrt(((one - other) ** 2).sum()))
            found.setdefault((node_of(topic), name), []).append((apart, t / 1e9))
    return found


@pytest.mark.parametrize("sizes", cases([(1, 1), (1, 10**6), (3000, 1700)], [(3000, 1700)]))
@pytest.mark.parametrize("edit", EDITS)
def test_differences_are_those_of_the_messages_however_chunks_are_cut(tmp_path, edit, sizes):
    a, b = made(), made(EDITS[edit])
    files = [
        put(tmp_path / f"{number}.mcap", of, size)
        for number, (of, size) in enumerate(zip((a, b), sizes, strict=True))
    ]
    for one, other, turned in ((a, b, files), (b, a, files[::-1])):
        with Reader(turned[0]) as left, Reader(turned[1]) as right:
            found = compare(left, right, curves=3)
        assert not found.is_same
        assert found.compared == "messages"
        topic, k = first_of(one, other)
        assert (found.first.topic, found.first.k) == (topic, k)
        assert found.ends == ((("B", "A")[one is b], 8) if edit == "ended" else None)
        expected = distances_of(one, other)
        assert [(d.robot, d.quantity) for d in found.distances] == sorted(
            expected, key=lambda of: of[0]
        )
        for distance in found.distances:
            apart, at = zip(*expected[distance.robot, distance.quantity], strict=True)
            assert distance.largest == pytest.approx(max(apart), rel=1e-12)
            assert distance.at == at[apart.index(max(apart))]
            assert distance.rms == pytest.approx(np.sqrt(np.mean(np.square(apart))), rel=1e-12)
        assert {*found.apart} == {of for of in expected if of[0] <= 3}
        for of, (times, apart) in found.apart.items():
            wanted = np.array(expected[of])
            assert times.tolist() == wanted[:, 1].tolist()
            assert apart == pytest.approx(wanted[:, 0], rel=1e-12)


@pytest.mark.parametrize("topic", ["/robot_3/sample", "/robot_3/state"])
def test_a_message_that_is_cut_is_refused_by_the_name_of_its_file(tmp_path, topic):
    def cut(messages):
        return [(*m[:3], m[3][:24] if m[1:3] == (topic, 5) else m[3]) for m in messages]

    files = [put(tmp_path / f"{n}.mcap", made(e), 3000) for n, e in (("a", cut), ("b", list))]
    for turned in (files, files[::-1]):
        with (
            Reader(turned[0]) as one,
            Reader(turned[1]) as other,
            pytest.raises(UnreadableError, match=r"a\.mcap: "),
        ):
            compare(one, other)


def test_whole_recordings_of_one_digest_are_the_same_and_no_chunk_is_read(tmp_path, monkeypatch):
    files = [put(tmp_path / f"{size}.mcap", made(), size) for size in (1, 10**6)]
    with Reader(files[0], verify=True) as one, Reader(files[1], verify=True) as other:
        found = compare(one, other)
        assert (found.is_same, found.compared) == (True, "computed digests")
    read = []
    seen = Reader._columns
    monkeypatch.setattr(
        Reader, "_columns", lambda self, span: read.append(span.offset) or seen(self, span)
    )
    with Reader(files[0]) as one, Reader(files[1]) as other:
        found = compare(one, other)
        assert (found.is_same, found.compared) == (True, "stored digests")
    assert len(read) == 2  # the first chunk of each, for the number of joints


def test_a_digest_that_was_sealed_into_another_recording_is_seen_through_when_asked(
    tmp_path, monkeypatch
):
    honest, liar = tmp_path / "honest.mcap", tmp_path / "liar.mcap"
    put(honest, made(), 3000)
    with Reader(honest) as reader:
        digest = reader.digest
    with monkeypatch.context() as patched:
        patched.setattr(
            writer_module,
            "tail",
            lambda *, fields, **rest: tail(fields={**fields, "digest": digest}, **rest),
        )
        put(liar, made(moved), 3000)
    stored = nrs("diff", honest, liar)
    assert stored.returncode == 0
    assert (
        "compared: scenarios and digests, that of a file whose every checksum agrees as it stands"
        in stored.stderr
    )
    assert json.loads(nrs("diff", honest, liar, "--json").stdout)["compared"] == "stored digests"
    asked = nrs("diff", honest, liar, "--verify", "--json")
    found = json.loads(asked.stdout)
    assert asked.returncode == 1
    assert f"the messages had the digest {digest} when written" in asked.stderr
    assert (found["same"], found["compared"], found["partial"]) == (False, "messages", ["B"])
    assert found["first"]["topic"] == "/robot_3/state"
