"""Recordings run again, changed and compared, each against a fresh run or the file's own bytes."""

import json
import threading
from itertools import count

import numpy as np
import pytest

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.network.endpoints import Endpoints
from nrs_cosim.bus.network.zenoh_bus import ZenohBus
from nrs_cosim.bus.transport import Message
from nrs_cosim.orchestrator.cli import terminal_replay
from nrs_cosim.orchestrator.engine.native.arranging import load_arranging
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.engine.summary import experiment_of
from nrs_cosim.orchestrator.replay import verify as verify_module
from nrs_cosim.orchestrator.replay.diff import compare
from nrs_cosim.orchestrator.replay.publish import as_recorded
from nrs_cosim.orchestrator.replay.verify import Verification, verify
from nrs_cosim.orchestrator.replay.what_if import parent, run_again
from nrs_cosim.orchestrator.scenario.changes import Change
from nrs_cosim.orchestrator.scenario.file import changed, parse_scenario, read_scenario
from nrs_cosim.recordings.mcap.arrangement import by_numpy
from nrs_cosim.recordings.mcap.digest import Digest
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.mcap.writer import Writer
from tests.command import nrs
from tests.guard import GUARD
from tests.network.ports import free_port
from tests.scenarios import PAPER, SCENARIOS, SHORT, example, paper
from tests.topics import node_of


def rewritten(path, into, change, turn=1, **options):
    """Write a recording again with some of its messages changed, every checksum right.

    Its channels are in the same order, or, where `turn` is -1, from the last to the first.
    """
    with Reader(path) as reader:
        writer = Writer(
            into,
            version="test",
            channels=reader.channels[::turn],
            schemas=reader.schemas,
            metadata={k: v for k, v in reader.metadata.items() if k.startswith("nrs.")
                      and k not in ("nrs.begin", "nrs.end")},
            attachments=reader.attachments,
            **options,
        )  # fmt: skip
        with writer:
            for batch in reader.batches():
                for k in sorted({message[2] for message in batch}):
                    writer.write(change([message for message in batch if message[2] == k]))
            writer.finish("completed")


def flipped(topic, k, at):
    """Return a change that flips the last bit of one byte of one message."""

    def change(tick):
        return [
            (t, name, q, data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
            if (name, q) == (topic, k)
            else (t, name, q, data)
            for t, name, q, data in tick
        ]

    return change


SMALL = sorted(set(SCENARIOS.glob("*.toml")) - {SCENARIOS / "random_10000.toml"})
"""All but the one that takes as long as all others; see test_scale.py."""
MOST_TICKS = 100
"""Of a scenario that are run; the paper's first example has all of its 300."""


@pytest.mark.parametrize("path", SMALL, ids=lambda path: path.stem)
def test_every_small_scenario_verifies_as_identical(path, tmp_path):
    whole = read_scenario(path)
    ticks = whole.clock.ticks if path.stem == PAPER else min(whole.clock.ticks, MOST_TICKS)
    shorter = whole.scenario.run.end * ticks / whole.clock.ticks
    file = example(path.stem, {"run.duration": round(shorter, 9)})
    outcome = run(file, tmp_path / "run.mcap")
    assert outcome.ticks == ticks
    with Reader(outcome.path) as reader:
        for plants in (True, False):
            verification = verify(reader, experiment_of(reader), plants=plants)
            assert verification.difference is None
            assert verification.ticks == outcome.ticks
            assert verification.messages == sum(
                not topic.endswith("/checkpoint")
                for batch in reader.batches()
                for _, topic, *_ in batch
            )
            counted = verification.messages + verification.checkpoints
            assert counted == outcome.messages == reader.message_count


def test_what_is_the_same_is_told_beside_the_checkpoints_that_are_not_computed_again():
    found = Verification(ticks=300, messages=15_006, difference=None, checkpoints=6)
    text = terminal_replay._compared(found, plants=True)
    assert text.endswith(
        "15006 messages, to the last bit, in ticks 0 to 300, beside 6 checkpoints of the plants"
    )


FLIPS = {
    # topic, byte, field: a sample is 19 bytes of header, then tag, length and doubles twice
    "an agent's sample": ("/robot_4/sample", 22, "position"),
    "the target's": ("/target/sample", 41, "velocity"),
    "a state": ("/robot_2/state", 22, "position"),
}


@pytest.mark.parametrize(("topic", "at", "field"), FLIPS.values(), ids=FLIPS.keys())
@pytest.mark.parametrize("plants", [True, False], ids=["plants", "agents"])
def test_a_flipped_bit_is_found_by_verify(tmp_path, plants, topic, at, field):
    run(paper(SHORT, {"run.output_step": 0.1}), tmp_path / "run.mcap")
    rewritten(tmp_path / "run.mcap", tmp_path / "bad.mcap", flipped(topic, 7, at))
    with Reader(tmp_path / "bad.mcap", verify=True) as reader:
        assert reader.damage == []
        found = verify(reader, experiment_of(reader), plants=plants).difference
    if topic == "/robot_2/state" and not plants:
        assert found is None  # without the plants, what they did is taken as recorded
        return
    assert (found.topic, found.k, found.field, found.robot) == (topic, 7, field, node_of(topic))
    assert found.recorded != found.replayed
    assert np.allclose(found.recorded, found.replayed)


@pytest.mark.parametrize(("plants", "k"), [(True, 4), (False, 4), (False, 0)])
def test_a_missing_or_extra_message_is_found_by_verify(tmp_path, plants, k):
    run(paper(SHORT), tmp_path / "run.mcap")
    rewritten(
        tmp_path / "run.mcap",
        tmp_path / "less.mcap",
        lambda tick: [m for m in tick if (m[1], m[2]) != ("/robot_3/state", k)],
    )
    with Reader(tmp_path / "less.mcap") as reader:
        found = verify(reader, experiment_of(reader), plants=plants).difference
        assert (found.topic, found.k, found.recorded) == ("/robot_3/state", k, "absent")
        with Reader(tmp_path / "run.mcap") as whole:
            first = compare(whole, reader).first
            assert (first.topic, first.k, first.replayed) == ("/robot_3/state", k, "absent")


def test_a_digest_that_is_not_of_the_messages_is_found_by_verify(tmp_path, monkeypatch):
    path = run(paper({"run.duration": 0.2}), tmp_path / "run.mcap").path
    with monkeypatch.context() as patched:
        patched.setattr(Digest, "hexdigest", lambda _self: "0" * 64)
        rewritten(path, tmp_path / "liar.mcap", lambda tick: tick)
    with Reader(tmp_path / "liar.mcap") as reader:
        assert (reader.computed, reader.damage) == (False, [])
        found = verify(reader, experiment_of(reader), plants=False)
        assert (found.status, found.difference, found.missing) == ("unverified", None, None)
        assert reader.damage == [f"the messages had the digest {'0' * 64} when written"]


@pytest.mark.parametrize("arranging", [load_arranging(), by_numpy], ids=["native", "numpy"])
@pytest.mark.parametrize("turn", [1, -1], ids=["channels", "channels in another order"])
def test_a_recording_verifies_whatever_its_channels_numbers_are(
    tmp_path, monkeypatch, arranging, turn
):
    path = run(paper({"run.duration": 0.2}), tmp_path / "run.mcap").path
    monkeypatch.setattr(verify_module, "load_arranging", lambda: arranging)
    rewritten(path, tmp_path / "other.mcap", lambda tick: tick, turn)
    with Reader(path) as one, Reader(tmp_path / "other.mcap") as other:
        assert one.digest == other.digest
        assert verify(other, experiment_of(other), plants=False).status == "identical"


ONE_HEAVY = "robots=3,plant.parameters={ m2 = 3.0 },controller.kp=150.0"


def test_a_what_if_with_another_plant_equals_a_fresh_run(tmp_path):
    """Estimates do not depend on plants, so the traffic under which they are run is the same."""
    run(paper(SHORT), tmp_path / "run.mcap")
    changes = [Change.of("--plant", ONE_HEAVY)]
    with Reader(tmp_path / "run.mcap") as reader:
        file = changed(experiment_of(reader), changes)
        launch = run_again(reader, file, [3])
        again = run(file, tmp_path / "what-if.mcap", launch, metadata=parent(reader, changes))
        parents = reader.digest
    own = {"id": 3, "plant": {"parameters": {"m2": 3.0}}, "controller": {"kp": 150.0}}
    fresh = run(paper(SHORT, {"robots": [own]}), tmp_path / "fresh.mcap")
    with Reader(again.path) as one, Reader(fresh.path) as other:
        assert one.digest == other.digest != parents
        assert one.metadata["nrs.parent"] == {"digest": parents, "change": f"--plant {ONE_HEAVY}"}
        assert compare(one, other).is_same
        assert verify(one, experiment_of(one), plants=True).difference is None
        by_robots = {tuple(p["robots"]): p for p in json.loads(one.metadata["nrs.run"]["plants"])}
        assert by_robots.keys() == {(3,), (1, 2, 4, 5, 6)}


@pytest.mark.parametrize("gains", ["beta=0.9,alpha=1.0", "algorithm.beta=0.9,alpha=1.0"])
def test_a_what_if_with_another_algorithm_equals_a_fresh_run(tmp_path, gains):
    run(paper(SHORT), tmp_path / "run.mcap")
    with Reader(tmp_path / "run.mcap") as reader:
        gains = Change.of("--algorithm", gains).within("algorithm")
        file = changed(experiment_of(reader), [gains])
    again = run(file, tmp_path / "what-if.mcap")
    fresh = run(
        paper(SHORT, {"algorithm.alpha": 1.0, "algorithm.beta": 0.9}),
        tmp_path / "fresh.mcap",
    )
    with Reader(again.path) as one, Reader(fresh.path) as other:
        assert one.digest == other.digest


@pytest.mark.parametrize(
    ("plant", "algorithm", "message"),
    [
        ("robots=7,plant.fmu=planar_robot", None, "robots[0].id: expected 1 to 6, got 7"),
        ("robots=x,plant.fmu=planar_robot", None, "--plant robots: expected robots like 1-3,7"),
        ("network.pinning=1", None, "network.pinning: expected a key of plant, controller"),
        ("kp=150", None, "kp: expected a key of plant, controller or disturbance, such as contr"),
        ("plant.fmo=planar_robot", None, "unknown key; did you mean 'fmu'?"),
        ("robots=3", None, "--plant: changes nothing"),
        ("fmu", None, "--plant: expected key=value, got 'fmu'"),
        (None, "gamma=1", "algorithm.gamma: unknown key"),
        (None, "algorithm.gamma=1", "algorithm.gamma: unknown key"),
        (None, "beta=fast", "algorithm.beta: expected"),
    ],
)
def test_a_wrong_change_is_named(plant, algorithm, message):
    with pytest.raises(InputError) as error:
        changed(
            paper(),
            [Change.of("--plant", plant).of_plants()]
            if plant
            else [Change.of("--algorithm", algorithm).within("algorithm")],
        )
    assert message in str(error.value)


def test_compared_distances_are_those_of_the_states(tmp_path):
    base, other = paper(SHORT), paper(SHORT, {"algorithm.beta": 0.9})
    for name, file in (("a", base), ("b", other)):
        run(file, tmp_path / f"{name}.mcap")
    tables = {}
    with Reader(tmp_path / "a.mcap") as a, Reader(tmp_path / "b.mcap") as b:
        found = compare(a, b)
        assert dict(found.fields) == {"algorithm.beta": (1.1, 0.9)}
        assert compare(a, a).is_same
        assert not found.why_not
        for name, reader in (("a", a), ("b", b)):
            rows = {}
            for batch in reader.batches():
                for time_ns, topic, _, data in batch:
                    if topic == "/robot_5/state":
                        rows[time_ns] = np.frombuffer(data[21:37], "<f8")  # q
            tables[name] = rows
    apart = {t: np.linalg.norm(q - tables["b"][t]) for t, q in tables["a"].items()}
    (q,) = [d for d in found.distances if (d.robot, d.quantity) == (5, "position")]
    assert q.largest == pytest.approx(max(apart.values()), rel=1e-12)
    assert q.at == max(apart, key=apart.get) / 1e9
    assert q.rms == pytest.approx(np.sqrt(np.mean(np.square([*apart.values()]))), rel=1e-12)
    assert found.first.topic == "/robot_1/state"
    assert found.first.t == pytest.approx(0.12)


def test_a_shorter_run_that_is_the_same_is_said_to_end_at_its_last_tick(tmp_path):
    a, b = (tmp_path / name for name in ("a.mcap", "b.mcap"))
    run(paper(SHORT), a)
    run(paper(SHORT, {"run.duration": 0.5}), b)
    for one, other, name in ((a, b, "B"), (b, a, "A")):
        done = nrs("diff", one, other)
        same = "up to there samples and states are the same, to the last bit"
        assert done.returncode == 1
        assert done.stdout.splitlines()[1:] == [f"{name} ends at tick 5; {same}"]
        result = json.loads(nrs("diff", one, other, "--json").stdout)
        assert (result["same"], result["ends"]) == (False, {"recording": name, "tick": 5})


JITTER = {"run.sampling_jitter": 0.2}
ALONE = "why_not", "no tick has times in common: sampling times differ"


def test_runs_of_other_sampling_times_are_not_compared(tmp_path):
    a, b, picture = (tmp_path / name for name in ("a.mcap", "b.mcap", "apart.png"))
    run(paper(SHORT), a)
    run(paper(SHORT, JITTER), b)
    done = nrs("diff", a, b)
    assert (done.returncode, done.stderr) == (1, f"apart: {ALONE[1]}\n")
    assert ALONE in json.loads(nrs("diff", a, b, "--json").stdout).items()
    done = nrs("diff", a, b, "--picture", picture)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"error: --picture: nothing to draw: {ALONE[1]}\n"
    assert not picture.exists()


def test_published_messages_arrive_complete_and_paced(tmp_path):
    run(paper(SHORT), tmp_path / "run.mcap")
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    waits, outcome = [], []
    with Reader(tmp_path / "run.mcap") as reader:
        expected = [message for batch in reader.batches() for message in batch]

        def put():
            endpoints = Endpoints(listen=(endpoint,), insecure_tcp=True)
            with as_recorded(reader, endpoints, 200_000_000, 800_000_000) as publication:
                assert publication.wait_for_listener(60.0)
                outcome.append(publication.publish(1e9, waits.append))

        thread = threading.Thread(target=put)
        thread.start()
        ear = ZenohBus(
            reader.digest[:16], Endpoints(connect=(endpoint,), wait=GUARD, insecure_tcp=True)
        )
        inbox = ear.listen("**")
        received = []
        wanted = [(m[1], m[3]) for m in expected if 200_000_000 <= m[0] < 800_000_000]
        for _ in count():
            received += [tuple(i) for i in inbox.take(60.0) if isinstance(i, Message)]
            if len(received) >= len(wanted):
                break
        thread.join()
        ear.close()
    assert [(f"/{key}", data) for key, data in received] == wanted
    assert outcome == [len(wanted)]
    assert sum(waits) < 1e-6


def test_a_changed_scenario_is_read_as_any_other():
    file = changed(paper(), [Change.of("--plant", ONE_HEAVY)])
    assert parse_scenario(file.text, "again", SCENARIOS, "again").scenario == file.scenario
    assert file.scenario.robots[0].plant.parameters == {"m2": 3.0}
    assert file.scenario.plant == paper().scenario.plant


def test_publishing_waits_for_a_listener(tmp_path):
    file = tmp_path / "run.mcap"
    run(paper(SHORT), file)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with Reader(file) as reader:
        wanted = [(m[1], m[3]) for batch in reader.batches() for m in batch]
        digest = reader.digest
    received = []

    def listen():
        ear = ZenohBus(digest[:16], Endpoints(connect=(endpoint,), wait=GUARD, insecure_tcp=True))
        inbox = ear.listen("**")
        while len(received) < len(wanted):
            received.extend(tuple(i) for i in inbox.take(GUARD) if isinstance(i, Message))
        ear.close()

    thread = threading.Thread(target=listen, daemon=True)
    thread.start()
    done = nrs(
        "replay", file, "--publish", "--as-fast-as-possible", "--insecure-tcp",
        "--listen", endpoint, "--wait", GUARD,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    thread.join(GUARD)
    assert [(f"/{key}", data) for key, data in received] == wanted
    assert f"{len(wanted)} messages were published" in done.stdout


def test_publishing_without_a_listener_names_the_key(tmp_path):
    file = tmp_path / "run.mcap"
    run(paper(SHORT), file)
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    done = nrs("replay", file, "--publish", "--insecure-tcp", "--listen", endpoint, "--wait", 0.001)
    assert done.returncode == 2
    assert "no subscriber to nrs/" in done.stderr
    assert "//" not in done.stderr
