"""The summary of a run counts what its links did, as its link events have it one by one."""

import json

import numpy as np
import pytest

import nrs_cosim as nrs
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.orchestrator.engine.link_summary import links_line, links_of
from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import LINKS
from tests.command import nrs as command
from tests.orchestrator.test_resealed import Sealed
from tests.scenarios import example, paper

EDGES, TICKS = 10, 50
OUT = [{"id": 2, "outages": [[2.0, 60.0]]}, {"id": 5, "outages": [[1.0, 1.5], [3.0, 3.2]]}]


@pytest.fixture(scope="module")
def lossy(tmp_path_factory):
    experiment = example("paper_lossy_links", {"run.duration": 5.0, "faults.robots": OUT})
    return experiment, run(experiment, tmp_path_factory.mktemp("links") / "run.mcap").path


def described(path, experiment, verify=False):
    with Reader(path, verify=verify) as reader:
        return links_of(reader, experiment)


def test_links_are_counted_as_their_events_have_it(lossy):
    experiment, path = lossy
    with nrs.Recording(path) as recording:
        events = recording.link_events()
    on_links = events[events["source"] != events["robot"]]
    lost, out = on_links["lost"] == 1, on_links["outage"] == 1
    late = ~lost & ~out & (on_links["delay"] > 0)
    said = described(path, experiment)
    assert said["samples"] == EDGES * TICKS
    assert said["lost"] == np.count_nonzero(lost) > 0
    assert said["outage"] == np.count_nonzero(out & ~lost) > 0
    assert said["late"] == np.count_nonzero(late) > 0
    assert said["latest"] == on_links["delay"][late].max() == 2
    assert said["altered"] == np.count_nonzero(~lost & ~out & ~late) > 0
    span = {"first": 2.0, "last": 5.0, "ticks": 31, "unbroken": True, "to_the_end": True}
    broken = {"first": 1.0, "last": 3.1, "ticks": 7, "unbroken": False, "to_the_end": False}
    assert said["silent"] == {"2": span, "5": broken}
    assert links_line(said) == (
        f"of 500 samples {said['lost']} lost, {said['late']} late (by up to 2 periods), "
        f"{said['outage']} in outages, {said['altered']} altered; robot 2 silent from 2 s to the "
        "end; robot 5 silent at 7 sampling times from 1 s to 3.1 s"
    )


def test_what_a_run_stored_is_what_its_messages_give_and_is_read_without_them(lossy, monkeypatch):
    experiment, path = lossy
    from_messages = described(path, experiment, verify=True)
    monkeypatch.setattr(Reader, "columns", None)
    assert described(path, experiment) == from_messages


@pytest.mark.parametrize(
    ("silent", "status"), [({"7": [1, 2, 2]}, 2), ({"2": [1, 51, 2]}, 2), ({"2": [1, 2, 2]}, 0)]
)
def test_counts_that_were_sealed_into_a_recording_are_seen_through(lossy, tmp_path, silent, status):
    experiment, path = lossy
    with Reader(path) as reader:
        stored = {**json.loads(reader.end[LINKS]), "silent": silent}
    bare = Sealed(path).again(tmp_path / "bare.mcap")
    assert described(bare, experiment) == described(path, experiment)

    def lie(end):
        return {**end, LINKS: json.dumps(stored)}

    liar = Sealed(path).again(tmp_path / "liar.mcap", ending=lie)
    done = command("info", liar, "--json")
    assert done.returncode == status
    if not status:
        damage = json.loads(command("info", liar, "--json", "--verify").stdout)["damage"]
        assert damage == ["nrs.end: links: is not what the messages give"]
    else:
        assert done.stderr.startswith(f"error: {liar}: nrs.end: links: silent: expected ticks")


def test_a_run_without_faults_says_nothing_of_links(tmp_path):
    experiment = paper({"run.duration": 0.2})
    path = run(experiment, tmp_path / "run.mcap").path
    assert described(path, experiment) is None
    with Reader(path) as reader:
        assert LINKS not in reader.end


@pytest.mark.parametrize("repeat", [None, 7])
def test_edges_of_switching_digraphs_are_those_of_each_tick(repeat):
    one, two = (
        Topology.of_edges(3, range(count), range(1, count + 1), np.ones(count)) for count in (3, 2)
    )
    of = [InteractionGraphs.of(one), InteractionGraphs.of(two)]
    schedule = TopologySchedule.of(of, (1, 4), repeat)
    expected = np.cumsum([(3, 2)[schedule.at(k)] for k in range(1, 31)])
    assert [schedule.edges_until(ticks) for ticks in range(1, 31)] == expected.tolist()
