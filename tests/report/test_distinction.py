"""What is drawn is told apart: lines by colour, dash and name, runs by what differs, phases."""

import re
from dataclasses import replace
from importlib.resources import files
from itertools import combinations

import numpy as np
import pytest

from nrs_cosim.orchestrator.engine.run import run
from nrs_cosim.recordings import Recording
from nrs_cosim.recordings.report import print as printed
from nrs_cosim.recordings.report.data import SHARES
from nrs_cosim.recordings.report.figures import figures, groups
from nrs_cosim.recordings.report.network import drawn
from nrs_cosim.recordings.report.page import page_data
from tests.recordings.made_up_runs import recorded as recorded_run
from tests.report.conftest import story
from tests.scenarios import example

EYES = {
    "all colours": np.eye(3),
    "no red": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "no green": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
}
"""Of linear sRGB, what is seen without one kind of cones (Machado, Oliveira, Fernandes 2009)."""


def linear(colours):
    srgb = np.array([[int(c[at : at + 2], 16) for at in (1, 3, 5)] for c in colours]) / 255
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def oklab(rgb):
    """Return Ottosson's OKLab (2020), in which distances are as they are seen."""
    lms = np.clip(rgb, 0, 1) @ np.transpose(
        [
            [0.4122214708, 0.5363325363, 0.0514459929],
            [0.2119034982, 0.6806995451, 0.1073969566],
            [0.0883024619, 0.2817188376, 0.6299787005],
        ]
    )
    return np.cbrt(lms) @ np.transpose(
        [
            [0.2104542553, 0.7936177850, -0.0040720468],
            [1.9779984951, -2.4285922050, 0.4505937099],
            [0.0259040371, 0.7827717662, -0.8086757660],
        ]
    )


def palette(dark):
    css = files("nrs_cosim.recordings.report").joinpath("web", "page.css").read_text("utf-8")
    found = re.findall(r"--(ink(?:-\d)?|card): (#\w{6})", css)
    names = dict(found[len(found) // 2 :] if dark else found[: len(found) // 2])
    return names.pop("card"), names


@pytest.mark.parametrize("dark", [False, True])
def test_no_two_colours_look_alike_to_eyes_without_red_or_green(dark):
    card, inks = palette(dark)
    for eye in EYES.values():
        seen = oklab(linear(inks.values()) @ np.transpose(eye))
        assert min(np.linalg.norm(a - b) for a, b in combinations(seen, 2)) > 0.13
    hues = np.sort(
        np.arctan2(*oklab(linear([c for name, c in inks.items() if "-" in name]))[:, :0:-1].T)
    )
    assert np.degrees(np.diff([*hues, hues[0] + 2 * np.pi])).min() > 30  # a hue each
    light = linear([card, *inks.values()]) @ [0.2126, 0.7152, 0.0722]
    ends = np.sort(np.stack([light[1:], np.full(len(inks), light[0])]), axis=0) + 0.05
    assert (ends[1] / ends[0] >= 3).all()  # WCAG 2.2, 1.4.11


def test_print_has_the_colours_of_the_page():
    _, inks = palette(dark=False)
    assert [inks[f"ink-{at}"] for at in range(8)] == [*printed.INKS]


def test_what_is_not_proven_is_unproven(lossy):
    (run_of,) = page_data([story(lossy)])["runs"]
    assert {row["status"] for row in run_of["measured"]} == {"unproven"}


def test_compared_runs_are_told_by_their_files_and_by_what_differs(paper, recorded):
    other = recorded("paper_first_order", {"algorithm.beta": 0.5, "run.duration": 3.0})
    data = page_data([story(paper), story(other)])
    assert [run["name"] for run in data["runs"]] == ["paper", "paper_first_order"]
    assert data["differences"] == [
        {"key": "run.duration", "paper": "30.0", "paper_first_order": "3.0"},
        {"key": "algorithm.beta", "paper": "1.1", "paper_first_order": "0.5"},
    ]
    shared = [{*run["lead"]} for run in data["runs"]]
    assert any("6 robots" in sentence for sentence in shared[0] & shared[1])
    looks = {(c["dash"], c["width"]) for c in data["figures"][0]["panels"][0]["curves"]}
    assert len(looks) == 3  # the target's, and one a run


def test_many_robots_are_bands_of_all_of_them(tmp_path):
    recorded_run(tmp_path / "a.mcap", n=30, m=2, ticks=3)
    of = story(tmp_path / "a.mcap")
    assert groups([of]) == [("all robots", 0), ("target", None)]
    with Recording(tmp_path / "a.mcap") as recording:
        states = recording.states()
    times = np.unique(states["t"])
    (estimates, *_) = figures([of])
    for panel in estimates.panels[:2]:
        expected = [
            np.quantile(states["reference_position"][states["t"] == t, panel.joint], SHARES)
            for t in times
        ]
        wide, half = panel.bands
        edges = [wide.low, half.low, panel.curves[0].y, half.high, wide.high]
        np.testing.assert_allclose(np.transpose(edges), expected, rtol=1e-12)
    assert len(page_data([of])["runs"][0]["groups"]) == 24


def test_a_network_of_many_robots_is_a_matrix_with_a_mark_a_link(recorded):
    network = {"generator": {"kind": "ring", "n": 50, "pinned": [1, 9]}}
    path = recorded("matrix", {"network": network, "run.duration": 0.1})
    picture = drawn(story(path))
    marks = re.findall(r'<g class="(link[^"]*) mark"><path d="([^"]*)"', picture)
    assert {kind: len(re.findall("M", path)) for kind, path in marks} == {
        "link pinning": 2,
        "link": 50,
    }


def test_links_of_a_network_that_changes_are_shown_by_phase(folder):
    file = example("switching", {"run.duration": 3.0})
    of = story(run(file, folder / "switching.mcap").path)
    (data,) = page_data([of])["runs"]
    found = re.findall(r'data-nodes="(\d) (\d)" data-phases="([\d ]+)"', data["network"])
    phases = [
        {(int(j), int(i)) for j, i, there in found if str(phase) in there.split()}
        for phase in range(3)
    ]
    assert phases[1] == {(j, j + 1) for j in range(6)}
    assert phases[2] == {(0, 6), *((6, i) for i in range(1, 6))}
    turns = data["turns"]
    assert turns["which"][:4] == [0, 1, 2, 0]
    assert turns["t"][:4] == pytest.approx([0, 1.1, 2.1, 2.6])


def test_the_joint_chooser_names_joints_as_their_plants_do(tmp_path):
    recorded_run(tmp_path / "a.mcap", n=2, m=2, ticks=3)
    of = story(tmp_path / "a.mcap")
    of = replace(of, subject=replace(of.subject, joints=["shoulder", "elbow"]))
    panels = [panel for figure in figures([of]) for panel in figure.panels]
    named = {(panel.joint, panel.joint_name) for panel in panels if panel.joint is not None}
    assert named == {(0, "shoulder"), (1, "elbow")}
