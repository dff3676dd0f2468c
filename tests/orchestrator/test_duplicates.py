"""Samples that come twice: recorded, counted, and without effect on any estimate."""

import numpy as np

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.orchestrator.replay.verify import verify
from nrs_cosim.orchestrator.report.subject import story_of
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.export.formats import export
from nrs_cosim.recordings.link_counts import KINDS
from nrs_cosim.recordings.mcap.reader import Reader
from tests.orchestrator.test_faults import LONGER, decoded, faulty_links
from tests.scenarios import paper

LOSSY_FROM_3 = {"from": 3, "loss": 0.5}


DUPLICATES = faulty_links({"duplicate": 0.4}, LOSSY_FROM_3)


def test_duplicates_are_recorded_and_change_no_estimate(tmp_path):
    lossy = faulty_links(LOSSY_FROM_3)
    doubled = paper(LONGER, DUPLICATES)
    run(paper(LONGER, lossy), tmp_path / "once.mcap")
    run(doubled, tmp_path / "twice.mcap")
    with Recording(tmp_path / "once.mcap") as once, Recording(tmp_path / "twice.mcap") as twice:
        assert once.digest == twice.digest
        events = twice.link_events()
        assert "duplicates" not in once.link_events().dtype.names
        lost = events[events["lost"] == 1]
        kept = [row[["k", "robot", "source"]].tolist() for row in lost]
        assert kept == once.link_events()[["k", "robot", "source"]].tolist()
        assert not lost["duplicates"].any()
        samples_of = {(row["k"], row["robot"]): row["position"] for row in twice.samples()}
    links = doubled.links
    expected = {
        (k, int(links.sink[f]), int(links.source[f]))
        for k in range(1, 21)
        for f in np.flatnonzero(links.outcome(k).duplicates)
    }
    doubles = events[events["duplicates"] > 0]
    assert {tuple(row) for row in doubles[["k", "robot", "source"]].tolist()} == expected
    assert len(expected) > 50
    for row in doubles:
        assert (row["lost"], row["outage"], row["delay"], row["duplicates"]) == (0, 0, 0, 1)
        assert row["position"].tolist() == samples_of[row["k"], row["source"]].tolist()


def test_duplicates_are_verified_exported_and_reported(tmp_path):
    file = paper(LONGER, DUPLICATES)
    with Reader(run(file, tmp_path / "run.mcap").path) as reader:
        assert verify(reader, file, plants=False).status == "identical"
        export(reader, tmp_path)
        table = tmp_path / "link_events.csv"
        header, *rows = table.read_text().splitlines()
        assert header.split(",")[4:9] == ["source", "lost", "outage", "delay", "duplicates"]
        doubled = sum(row.split(",")[8] == "1" for row in rows)
        story = story_of(reader, file)
        message = next(decoded(reader, "/robot_2/link_event"))
        assert message.HasField("duplicates")
    kinds = [KINDS[number] for number in story.link_events.kind]
    assert kinds.count("duplicated") == doubled > 0
    assert kinds.count("lost") + doubled == len(rows)
