"""Whole runs with faults: recorded numbers and faults against plain Python, and what is refused."""

import tomllib

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from nrs_cosim.bus.random_streams import normal, random_stream
from nrs_cosim.bus.signature import Signer
from nrs_cosim.bus.validation import RejectedError
from nrs_cosim.orchestrator.engine.robots import wire_of
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.orchestrator.scenario.file import parse_scenario, read_scenario
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.export.tables import samples, states
from nrs_cosim.recordings.mcap.reader import Reader
from tests.estimator_agents.plain_link_faults import Network, simulate
from tests.scenarios import SCENARIOS, SECOND_ORDER, SHORT, paper

LOSSY = SCENARIOS / "paper_lossy_links.toml"
FAULTY = {
    "faults": {
        "links": [
            {"loss": 0.3, "noise": 0.5},
            {"from": 3, "noise": {"velocity": 0.25}, "quantisation": 0.5, "delay": 1},
            {"to": 5, "delay": {"uniform": [0, 3]}, "outages": [[1.0, 1.25], [1.5, 1.6]]},
        ],
        "robots": [{"id": 4, "outages": [[0.85, 1.45]]}, {"id": 3, "outages": [[1.9, 9.0]]}],
    }
}
LONGER = {"run.duration": 2.0}


def faulty_links(*entries):
    """Return a change of the paper's example that adds faults of links to it."""
    return {"faults.links": list(entries)}


def faulty_robots(*entries):
    """Return a change of the paper's example that adds faults of robots to it."""
    return {"faults.robots": list(entries)}


def network_of(text):
    """Return the oracle's network of a scenario's text, read by itself."""
    scenario = tomllib.loads(text)
    w = [
        [float(pin), *map(float, row)]
        for pin, row in zip(
            scenario["network"]["pinning"], scenario["network"]["adjacency"], strict=True
        )
    ]
    links = {}
    for entry in scenario["faults"]["links"]:
        for i in range(1, len(w) + 1):
            for j in range(len(w) + 1):
                named = entry.get("from", j) == j and entry.get("to", i) == i
                if w[i - 1][j] and named:
                    links.setdefault((j, i), {}).update(in_units(entry))
    return Network(
        w,
        links,
        {robot["id"]: in_ns(robot["outages"]) for robot in scenario["faults"].get("robots", [])},
        gaps=(100_000_000,),
        seed=scenario["run"]["seed"],
        missing=scenario["algorithm"].get("missing", "hold"),
    )


def in_ns(spans):
    return [tuple(round(t * 1e9) for t in span) for span in spans]


def in_units(entry):
    """Return an entry's keys as the oracle takes them."""
    units = {}
    for key, value in entry.items():
        if key == "delay":
            units[key] = value["uniform"] if isinstance(value, dict) else (value, value)
        elif key == "outages":
            units[key] = in_ns(value)
        elif key in {"noise", "quantisation"}:
            pair = value if isinstance(value, dict) else {"position": value, "velocity": value}
            units[key] = (pair.get("position", 0), pair.get("velocity", 0))
        elif key == "loss":
            units[key] = value
    return units


def first_order(left, dp, dv):
    position = [x + 0.9 * d for x, d in zip(left[0], dp, strict=True)]
    return [position, [x + 1.1 * d for x, d in zip(left[1], dv, strict=True)]]


def second_order(left, dp, dv):
    moved = zip(left[1], dp, dv, strict=True)
    return [left[0], [x + (1.1 * a + 0.9 * b) for x, a, b in moved]]


def decoded(reader, topic):
    """Yield a recording's messages as protobuf reads them by the recording's own schema."""
    names = {channel.topic: channel.schema_name for channel in reader.channels}
    schemas = {schema.name: schema.data for schema in reader.schemas}
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString(schemas[names[topic]]).file:
        pool.Add(file)
    read = message_factory.GetMessageClass(pool.FindMessageTypeByName(names[topic]))
    for time_ns, _, sequence, data in reader.messages([topic]):
        message = read.FromString(data)
        assert (message.time_ns, message.k) == (time_ns, sequence)
        yield message


def link_events_of(reader):
    """Return the recorded faults by tick, as the oracle tells them."""
    by_tick = {}
    for channel in reader.channels:
        if channel.topic.endswith("/link_event"):
            assert not channel.counted
            for fault in decoded(reader, channel.topic):
                assert channel.topic == f"/robot_{fault.robot}/link_event"
                flags = (fault.lost, fault.outage, fault.delay)
                row = (fault.robot, fault.source, *flags)
                by_tick.setdefault(fault.k, []).append(
                    (*row, list(fault.position), list(fault.velocity))
                )
    return {k: sorted(faults) for k, faults in by_tick.items()}


@pytest.mark.parametrize("missing", ["hold", "drop"])
@pytest.mark.parametrize("order", [1, 2], ids=["first", "second"])
def test_a_run_with_faults_agrees_with_plain_python(tmp_path, order, missing):
    algorithm = SECOND_ORDER if order == 2 else {}
    file = paper(LONGER, algorithm, {"algorithm.missing": missing}, FAULTY)
    outcome = run(file, tmp_path / "run.mcap")
    assert outcome.status == "completed", outcome.reason
    agree_with_plain_python(file, tmp_path / "run.mcap", order)


def agree_with_plain_python(file, path, order=1):
    network = network_of(file.text)
    with Reader(path, verify=True) as reader:
        assert reader.damage == []
        first = next(iter(states(reader)))[:6]
        sampled = np.concatenate(list(samples(reader)))
        faults = link_events_of(reader)
        ticks = reader.ticks
    start = {
        row["robot"]: (row["reference_position"].tolist(), row["reference_velocity"].tolist())
        for row in first
    }
    targets = {
        row["k"]: [row["position"].tolist(), row["velocity"].tolist()]
        for row in sampled[sampled["robot"] == 0]
    }
    jump = first_order if order == 1 else second_order
    story = simulate(network, jump, start, targets, 0.1, ticks)
    assert any(theirs for *_, theirs in story)
    for k, (left, _, theirs) in enumerate(story, start=1):
        ours = {row["robot"]: row for row in sampled[sampled["k"] == k]}
        assert set(ours) == {i for i in range(7) if not network.silent(i, k)}
        for robot, row in ours.items():
            if robot:
                assert [row["position"].tolist(), row["velocity"].tolist()] == left[robot]
        assert faults.get(k, []) == theirs


def test_the_scenario_with_lossy_links_agrees_with_plain_python(tmp_path):
    """It completes, the same twice, and says of each sample what plain Python says."""
    file, digests = read_scenario(LOSSY), set()
    for name in ("a", "b"):
        outcome = run(file, tmp_path / f"{name}.mcap")
        assert (outcome.status, outcome.ticks) == ("completed", 300)
        with Reader(outcome.path, verify=True) as reader:
            digests.add(reader.digest)
            assert reader.message_count == outcome.messages
    assert len(digests) == 1
    agree_with_plain_python(file, tmp_path / "a.mcap")


def test_the_seed_decides_what_is_lost(tmp_path):
    lost = []
    for seed in (1, 2):
        file = paper(SHORT, {"run.seed": seed}, faulty_links({"loss": 0.5}))
        with Reader(run(file, tmp_path / f"{seed}.mcap").path) as reader:
            lost.append(
                {(k, f[0], f[1]) for k, told_at in link_events_of(reader).items() for f in told_at}
            )
            assert all(
                f[2:5] == (1, 0, 0) for told_at in link_events_of(reader).values() for f in told_at
            )
    assert lost[0] != lost[1]


def test_faults_of_zero_change_no_byte(tmp_path):
    nothing = faulty_links({"loss": 0.0, "delay": 0, "outages": [], "noise": 0})
    batches = []
    for name, change in (("without", {}), ("none", nothing)):
        file = paper(SHORT, change)
        with Reader(run(file, tmp_path / f"{name}.mcap").path) as reader:
            assert [schema.name for schema in reader.schemas] == ["nrs.Sample", "nrs.State"]
            assert len(reader.channels) == 13
            batches.append(list(reader.messages()))
    assert batches[0] == batches[1]


def test_with_all_links_cut_the_estimated_velocities_stay(tmp_path):
    file = paper(SHORT, faulty_links({"loss": 1}))
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        sampled = np.concatenate(list(samples(reader)))
        assert all(len(faults) == 10 for faults in link_events_of(reader).values())
    for robot in range(1, 7):
        mine = sampled[sampled["robot"] == robot]["velocity"]
        assert (mine == mine[0]).all()


def test_a_recording_with_silent_robots_is_exported(tmp_path):
    file = paper(SHORT, faulty_robots({"id": 2, "outages": [[0.3, 0.5]]}))
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        table, *_ = export(reader, tmp_path)
        assert [channel.topic for channel in reader.channels if not channel.counted] == [
            "/robot_1/link_event",
            "/robot_2/link_event",
            "/robot_5/link_event",
        ]
    rows = [line.split(",")[:4] for line in table.read_text().splitlines()[1:]]
    silent = {(k, robot) for k in range(1, 11) for robot in range(7)} - {
        (int(k), int(robot)) for k, _, _, robot in rows
    }
    assert silent == {(3, 2), (4, 2)}


def test_samples_of_a_silent_robot_are_rejected():
    file = paper(SHORT, faulty_robots({"id": 2, "outages": [[0.1, 0.2]]}))
    wire = wire_of(file, {"here": range(1, 7)}, Signer())

    def batch(k, robots):
        records = wire.samples.blank(np.array(robots))
        records["k"], records["time_ns"] = k, k * 100_000_000
        return wire.pack_samples("here", k, records)

    silent, all_of_them = [1, 3, 4, 5, 6], [1, 2, 3, 4, 5, 6]
    assert wire.unpack_samples("here", batch(1, silent))[1]["robot"].tolist() == silent
    assert wire.unpack_samples("here", batch(2, all_of_them))[1]["robot"].tolist() == all_of_them
    for k, robots in ((1, all_of_them), (2, silent)):
        with pytest.raises(RejectedError, match="size"):
            wire.unpack_samples("here", batch(k, robots))


def test_the_scenario_with_lossy_links_is_the_papers_otherwise():
    ours, papers = read_scenario(LOSSY).scenario, paper().scenario
    for part in ("controller", "network", "target", "plant", "disturbance", "initial", "robots"):
        assert getattr(ours, part) == getattr(papers, part)
    assert len(ours.faults.links) == 3
    assert parse_scenario(LOSSY.read_text("utf-8"), "a", SCENARIOS, "a").scenario == ours


def test_a_further_field_arrives_with_its_own_noise_and_the_others_as_without_it(tmp_path):
    """Of what dcea3 sends, the acceleration; block 64 is that of NumPy draws of a link."""
    given = {"loss": 0.2, "noise": {"velocity": 0.25}}
    noisy = {**given, "noise": {"acceleration": 0.5, "velocity": 0.25}}
    third = {"algorithm": {"name": "dcea3", "alpha": 0.7, "beta": 0.6, "gamma": 0.5}}
    found = {}
    for name, entry in (("plain", given), ("noisy", noisy)):
        file = paper(LONGER, third, faulty_links(entry))
        with Recording(run(file, tmp_path / f"{name}.mcap").path) as recording:
            events, sent = recording.link_events(), recording.samples()
            found[name] = events, {(row["k"], row["robot"]): row for row in sent}
    seed = file.scenario.run.seed
    events, sent = found["noisy"]
    arrived = events[events["lost"] == 0]
    assert len(arrived) > 100
    for row in arrived:
        k, i, j = (int(row[name]) for name in ("k", "robot", "source"))
        own = random_stream(seed, "link noise acceleration", j, i, k // 64)
        pair = normal(random_stream(seed, "link noise", j, i, k // 64), (64, 2, 2))[k % 64]
        was = sent[k, j]
        noise = normal(own, (64, 2))[k % 64]
        assert row["acceleration"].tolist() == (was["acceleration"] + 0.5 * noise).tolist()
        assert row["velocity"].tolist() == (was["velocity"] + 0.25 * pair[1]).tolist()
        assert row["position"].tolist() == was["position"].tolist()
    plain = found["plain"][0]
    keys = ["k", "robot", "source", "lost"]
    assert plain[keys].tolist() == events[keys].tolist()
    with Reader(tmp_path / "noisy.mcap") as reader:
        assert verify(reader, file, plants=False).status == "identical"
