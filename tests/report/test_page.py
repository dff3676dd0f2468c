"""A page says what the recording says: the numbers, the words, and nothing from anywhere else."""

import json
import re
from base64 import b64decode
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes
from nrs_cosim.bus.messages import LINK_EVENT, Codec
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.export.tables import samples, states
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.report.curves import BUCKETS
from nrs_cosim.recordings.report.figures import figures
from nrs_cosim.recordings.report.page import page
from nrs_cosim.recordings.robots.skeleton import skeletons
from tests.recordings.made_up_runs import recorded as recorded_run
from tests.report.conftest import story

nrs = CliRunner()


def sentences_of(text):
    """Return what a page's script is told."""
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text)
    return json.loads(data)


def numbers(data, at):
    kind = {"f4": "<f4", "f8": "<f8"}[data["arrays"][at]["kind"]]
    return np.frombuffer(b64decode(data["arrays"][at]["data"]), kind)


def table_of(path, read):
    with Reader(path) as reader:
        return np.concatenate(list(read(reader)))


def test_each_curve_has_the_exact_extremes_of_the_recording(recorded):
    path = recorded("fine", {"run.output_step": 0.005})
    data, rows = sentences_of(page([story(path)])), table_of(path, states)
    seen = 0
    for figure, name in (("estimates", "reference_position"), ("estimates", "reference_velocity")):
        panels = next(f for f in data["figures"] if f["name"] == figure)["panels"]
        symbol = {"reference_position": "ε_i", "reference_velocity": "υ_i"}[name]
        for panel in (panel for panel in panels if panel["label"].startswith(symbol)):
            for curve in panel["curves"]:
                if curve["group"] == "target":
                    continue
                robot = int(curve["name"].removeprefix("robot "))
                mine = rows[rows["robot"] == robot]
                expected = mine[name][:, panel["joint"]]
                t, y = numbers(data, curve["x"]), numbers(data, curve["y"])
                assert len(expected) == 6001 > 3 * BUCKETS >= len(y)
                assert (y.min(), y.max()) == (expected.min(), expected.max())
                at = np.searchsorted(mine["time_ns"] / 1e9, t)
                assert (expected[at] == y).all()
                seen += 1
    assert seen == 2 * 2 * 6


def test_tracking_errors_are_joints_less_the_target(paper):
    data, rows = sentences_of(page([story(paper)])), table_of(paper, states)
    t = rows["time_ns"] / 1e9
    target = np.stack([2 * t + np.sin(t), -2 * t - np.cos(t)], axis=1)
    (panels,) = (f["panels"] for f in data["figures"] if f["name"] == "tracking")
    for panel in panels[:2]:
        for robot, curve in enumerate(panel["curves"], start=1):
            mine = rows["robot"] == robot
            errors = (rows["position"] - target)[mine, panel["joint"]]
            np.testing.assert_allclose(numbers(data, curve["y"]), errors, atol=1e-12)


def test_what_agents_keep_has_a_panel_for_each_number(recorded):
    third = {"algorithm": {"name": "kalman_consensus", "q": 1.0, "r": 1e-4}, "run.duration": 2.0}
    path = recorded("kalman", third)
    data = sentences_of(page([story(path)]))
    (figure,) = (f for f in data["figures"] if f["name"] == "agent_states")
    assert " velocity_variance: of the estimated velocity. " in figure["about"]
    panels = figure["panels"]
    with Recording(path) as recording:
        rows = recording.agent_states()
    assert [(panel["label"], panel["joint"]) for panel in panels] == [
        ("position_variance", None),
        ("covariance", None),
        ("velocity_variance", None),
        ("information, joint 1", 0),
        ("information, joint 2", 1),
        ("precision", None),
    ]
    for panel, numbers_of in zip(
        panels,
        [
            *(rows[name] for name in ("position_variance", "covariance", "velocity_variance")),
            *rows["information"].T,
            rows["precision"],
        ],
        strict=True,
    ):
        for robot, curve in enumerate(panel["curves"], 1):
            mine = rows["robot"] == robot
            assert (curve["name"], curve["group"]) == (f"robot {robot}", f"robot {robot}")
            assert numbers(data, curve["x"]).tolist() == rows["t"][mine].tolist()
            assert numbers(data, curve["y"]).tolist() == numbers_of[mine].tolist()


def test_of_a_field_of_many_numbers_the_norm_is_drawn(tmp_path):
    kept = {**ESTIMATE, "votes": Field((4, 4), unit="m"), "trust": Field((2,))}
    codecs = Codecs.of(Sizes(2), "Mine", kept=kept)
    recorded_run(tmp_path / "a.mcap", n=2, m=2, ticks=3, codecs=codecs)
    (figure,) = (f for f in figures([story(tmp_path / "a.mcap")]) if f.name == "agent_states")
    assert [panel.label for panel in figure.panels] == ["‖votes‖₂ (m)", "trust_1", "trust_2"]
    with Recording(tmp_path / "a.mcap") as recording:
        rows = recording.agent_states(robots=2)
    norms = np.sqrt((rows["votes"] ** 2).sum(axis=(1, 2)))
    np.testing.assert_allclose(figure.panels[0].curves[1].y, norms, rtol=1e-12)


def test_recordings_over_one_another_share_the_panels_of_what_both_keep(recorded):
    paths = []
    for name, kappa in (("one", 0.1), ("two", 0.2)):
        algorithm = {"name": "pi_consensus", "alpha": 0.7, "beta": 1.0, "kappa": kappa}
        paths.append(recorded(name, {"algorithm": algorithm, "run.duration": 2.0}))
    both = [story(path) for path in (*paths, recorded("plain", {"run.duration": 2.0}))]
    (figure,) = (f for f in figures(both) if f.name == "agent_states")
    assert [len(panel.curves) for panel in figure.panels] == [12, 12]
    assert [f.name for f in figures(both[2:])][:2] == ["estimates", "tracking"]


def test_envelopes_are_maxima_over_robots(paper):
    rows = table_of(paper, samples)
    t = rows["time_ns"] / 1e9
    target = np.stack([2 * t + np.sin(t), -2 * t - np.cos(t)], axis=1)
    errors = np.abs(rows["position"] - target).max(axis=1)
    largest = [errors[rows["k"] == k].max() for k in range(1, 301)]
    envelope = story(paper).envelopes["position_estimate"]
    np.testing.assert_allclose(envelope.largest, largest, atol=1e-12)
    assert envelope.t.tolist() == [k / 10 for k in range(1, 301)]


def test_a_page_is_small_and_self_contained(paper, tmp_path):
    result = nrs.invoke(app, ["report", str(paper), "-o", str(tmp_path / "page.html")])
    assert result.exit_code == 0, result.output
    written = (tmp_path / "page.html").read_bytes()
    assert len(written) < 5_000_000
    text = written.decode()
    assert not re.search(r"https?:|wss?:|\bsrc=|\bhref=|url\(|@import", text, re.IGNORECASE)
    assert "default-src 'none'" in text
    assert "connect-src 'none'" in text


def test_a_page_shows_the_runs_words_and_numbers(paper):
    (run,) = sentences_of(page([story(paper)]))["runs"]
    lead = " ".join(run["lead"])
    assert "6 robots with 2 joints each (two_link_arm) follow" in lead
    assert "a target, from which robot 3 receives" in lead
    assert "dcea1 (alpha = 0.9, beta = 1.1)" in lead
    assert [row["status"] for row in run["measured"]] == ["within"] * 4
    (plants,) = run["plants"]
    assert (plants["robots"], plants["FMU"]) == ("robots 1-6", "two_link_arm")
    assert plants["controller"] == "kp = 200.0, kd = 300.0"
    assert plants["joints"] == "q[1] (rad), q[2] (rad)"
    measured = [row["value"] for row in run["measured"]]
    assert measured == pytest.approx([0.15131, 0.43971, 0.444, 0.497], rel=0.02)  # paper.md
    counted = {
        name: sentences_of for name, sentences_of in run["counted"].items() if "spent" not in name
    }
    assert counted == {"samples": "2,100", "states": "9,006"}
    assert run["counted"].keys() - counted.keys() >= {
        "spent, here, plants (s)",
        "spent, here, bus (s)",
    }
    assert [v["name"] for v in run["conditions"]] == [
        *("alpha", "beta", "kp", "kd", "kp (tracking)", "kd (tracking)"),
    ]
    assert {v["status"] for v in run["conditions"]} == {"holds"}
    assert run["spectral_radius"] == pytest.approx(0.877817, abs=1e-6)
    assert run["network"].count('data-robot="') == 7
    received = re.findall(r'data-nodes="(\d) (\d)"', run["network"])
    expected = "12 13 21 30 41 43 52 53 54 63"  # the paper's digraph: i receives from j
    assert sorted(i + j for j, i in received) == expected.split()


def test_the_slope_of_rho_is_only_shown_without_link_faults(paper, lossy):
    for path, there in ((paper, True), (lossy, False)):
        data = sentences_of(page([story(path)]))
        (figure,) = (f for f in data["figures"] if f["name"] == "envelopes")
        drawn = [c["name"] for panel in figure["panels"] for c in panel["curves"]]
        assert any("slope of ρ" in name for name in drawn) == there
        assert ("slope" in json.dumps(figure["about"])) == there
        (run,) = data["runs"]
        assert (run["spectral_radius"] is not None) == there


def test_lower_bounds_on_gains_are_shown_as_such(paper):
    (run,) = sentences_of(page([story(paper)]))["runs"]
    rows = {v["name"]: v for v in run["conditions"]}
    assert [v["at_least"] for v in rows.values()] == [False, False, *[True] * 4]
    assert (rows["kp"]["value"], rows["kp"]["bound"]) == (200, 0)
    assert rows["kd (tracking)"]["value"] == 300 > rows["kd (tracking)"]["bound"] > 0


def test_a_page_shows_the_end_of_the_run(paper):
    spent = replace(story(paper), ending={"time": '{"worker": {"plants": 0.5}}', "note": "a word"})
    (run,) = sentences_of(page([spent]))["runs"]
    assert run["counted"]["time, worker, plants"] == "0.5"
    assert run["counted"]["note"] == "a word"


def test_theoretical_bounds_are_shown_beside_measurements(paper):
    plain = story(paper)
    bounds = {"position_estimate": {"sharp": 0.2, "paper’s": float("inf")}}
    data = sentences_of(page([replace(plain, subject=replace(plain.subject, bounds=bounds))]))
    (run,) = data["runs"]
    assert run["measured"][0]["bounds"] == {"sharp": 0.2}
    (figure,) = (f for f in data["figures"] if f["name"] == "envelopes")
    (line,) = (c for c in figure["panels"][0]["curves"] if "sharp" in c["name"])
    assert numbers(data, line["y"]).tolist() == [0.2, 0.2]


def test_a_page_shows_the_recorded_link_events(lossy):
    data = sentences_of(page([story(lossy)]))
    (figure,) = (f for f in data["figures"] if f["name"] == "link_events")
    (panel,) = figure["panels"]
    with Reader(lossy) as reader:
        topics = [f"/robot_{robot}/link_event" for robot in range(1, 7)]
        met = Codec(LINK_EVENT, Sizes(2)).decode([m[3] for m in reader.messages(topics)])
    lost = met[met["lost"] > 0]
    expected = Counter(zip(lost["robot"].tolist(), lost["source"].tolist(), strict=True))
    (curve,) = (c for c in panel["curves"] if c["name"] == "lost")
    x = numbers(data, curve["x"]).reshape(-1, 3)
    y = numbers(data, curve["y"]).reshape(-1, 3)
    found: Counter[str] = Counter()
    for (first, last, _), (row, *_) in zip(x, y, strict=True):
        found[panel["rows"][int(row)]] += round((last - first) / 0.1) + 1
    (run,) = data["runs"]
    assert run["counted"]["link events"] == f"{len(met):,}"
    assert f" samples {len(lost)} lost" in (lead := " ".join(run["lead"]))
    assert "robot 4 silent from " in lead
    names = {f"{i} ← {j or 'target'}": count for (i, j), count in expected.items()}
    assert found == names
    assert "4 silent" in panel["rows"]


def test_several_recordings_are_overlaid(paper, lossy):
    data = sentences_of(page([story(paper), story(lossy), story(paper)]))
    names = ["paper (1)", "paper_lossy_links", "paper (2)"]  # by their files, then by numbers
    assert [group["name"] for group in data["groups"]] == [*names, "target"]
    first = data["figures"][0]["panels"][0]
    drawn = Counter(curve["group"] for curve in first["curves"])
    assert [drawn[name] for name in names] == [6, 6, 6]
    inks = {curve["group"]: curve["ink"] for curve in first["curves"]}
    assert [inks[name] for name in names] == [0, 1, 2]


def test_a_cut_recording_is_drawn_as_far_as_it_goes(paper, tmp_path):
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(paper.read_bytes()[:300_000])
    result = nrs.invoke(app, ["report", str(cut), "-o", str(tmp_path / "page.html")])
    assert result.exit_code == 0
    (run,) = sentences_of((tmp_path / "page.html").read_text("utf-8"))["runs"]
    assert run["status"] == "unfinished"
    assert "the file ends inside a record" in run["damage"][0]
    assert "of 300 sampling times" in " ".join(run["lead"])


def test_a_damaged_chunk_is_drawn_as_a_gap(paper, tmp_path):
    damaged = bytearray(paper.read_bytes())
    damaged[400_000] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(damaged)
    gap = story(path)
    assert gap.damage
    missing = np.isnan(gap.vectors["position"][:, 0, 0])
    assert 0 < missing.sum() < len(missing) / 2
    estimates = figures([gap])[0].panels[0].curves[0]
    assert np.isnan(estimates.y).sum() == missing.sum()


def test_a_run_before_its_first_tick_has_a_page(empty):
    data = sentences_of(page([story(empty)]))
    (run,) = data["runs"]
    assert data["figures"] == []
    assert run["motion"] is None
    assert "0 of 300 sampling times" in " ".join(run["lead"])


def test_names_from_a_recording_are_escaped(recorded):
    path = recorded("</script><b>{{plotly}}", {"run.duration": 1.0})
    text = page([story(path)])
    assert "</script><b>" not in text
    assert sentences_of(text)["runs"][0]["name"] == "</script><b>{{plotly}}"


def test_arms_are_drawn_where_their_links_are(recorded):
    path = recorded("arms", {"run.duration": 1.0, "plant.parameters": {"r2": 0.5}})
    drawn = story(path).skeletons[0]
    q = np.array([[0.3, 0.4], [np.nan, 1.0]])
    assert (drawn.parents, drawn.known) == ((0, 1, 2), True)
    elbow, tip = drawn.points(q)[0, 2:]
    assert elbow == pytest.approx([np.cos(0.3), np.sin(0.3)])
    assert tip - elbow == pytest.approx([0.5 * np.cos(0.7), 0.5 * np.sin(0.7)])
    assert np.isnan(drawn.points(q)[1, 3]).all()


def test_robots_of_which_no_urdf_is_known_are_chains_of_unit_links(tmp_path):
    recorded_run(tmp_path / "a.mcap", n=2, m=3, ticks=2)
    with Reader(tmp_path / "a.mcap") as reader:
        (drawn, _) = skeletons(reader, [1, 2], 3)
    assert (drawn.parents, drawn.known) == ((0, 1, 2, 3), False)
    straight = drawn.points(np.zeros((1, 3)))[0]
    assert straight.tolist() == [[x, 0] for x in (0, 0, 1, 2, 3)]


def test_a_point_is_drawn_in_the_plane_of_its_joints(recorded):
    path = recorded("points", {"run.duration": 0.2, "plant": {"fmu": "planar_robot"}})
    assert story(path).skeletons[0].parents == ()
    (run,) = sentences_of(page([story(path)]))["runs"]
    assert run["motion"]["target_points"] is None


def test_an_unwritable_output_is_named(paper, tmp_path):
    (tmp_path / "file").touch()
    result = nrs.invoke(app, ["report", str(paper), "-o", str(tmp_path / "file" / "page.html")])
    assert "file: is a file and not a folder" in str(result.exception)
