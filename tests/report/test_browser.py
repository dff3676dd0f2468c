"""A page in a browser draws all that it has, moves, and can be read by night and on a phone."""

import re

import numpy as np
import pytest

from nrs_cosim.recordings.report.page import page
from tests.report.conftest import story

pytest.importorskip("selenium")
from tests.report.browser import Look


@pytest.fixture(scope="module")
def address(paper, folder):
    (folder / "paper.html").write_text(page([story(paper)]), "utf-8")
    return (folder / "paper.html").as_uri()


@pytest.fixture
def look(chromium, address):
    return Look(chromium, address).ready()


def test_every_figure_is_drawn_with_its_lines(look):
    drawn = look.drawn()
    assert [label for label, *_ in drawn] == [
        "εi, joint 1 (rad)", "εi, joint 2 (rad)", "υi, joint 1 (rad/s)", "υi, joint 2 (rad/s)",
        "ei, joint 1 (rad)", "ei, joint 2 (rad)", "ėi, joint 1 (rad/s)", "ėi, joint 2 (rad/s)",
        "max ‖εi − ε0‖∞ at tk (rad)", "max ‖υi − υ0‖∞ at tk (rad/s)",
        "max ‖ei‖₂ (rad)", "max ‖ėi‖₂ (rad/s)",
    ]  # fmt: skip
    assert [lines for *_, lines in drawn] == [7] * 4 + [6] * 4 + [5, 4, 3, 3]
    assert [points for _, points, _ in drawn] == [7 * 1501] * 4 + [6 * 1501] * 4 + [
        308,
        306,
        1505,
        1505,
    ]
    assert look.ask("document.querySelectorAll('#network .node').length") == 7
    assert look.ask("document.querySelectorAll('#network .link').length") == 10
    assert "paper_first_order" in look.ask("document.title")
    beside = look.ask(
        "[...document.querySelectorAll('#figure-envelopes .plot')].map(plot =>"
        " [...plot.querySelectorAll('.annotation-text')].map(text => text.textContent))"
    )
    of_laws = [["measured", "steady state", "worst case", "paper", "ρ"]] * 2 + [
        ["measured", "worst case", "paper"]
    ] * 2
    seen = [[re.sub(r" [\d.]+$", "", text) for text in texts] for texts in beside]
    assert seen == [of_laws[0], of_laws[0][:4], *of_laws[2:]]
    assert look.ask("document.querySelectorAll('.tile .verdict.within').length") == 4
    assert not look.complaints()


def test_faults_and_several_recordings_are_drawn(chromium, paper, lossy, folder):
    (folder / "both.html").write_text(page([story(paper), story(lossy)]), "utf-8")
    look = Look(chromium, (folder / "both.html").as_uri()).ready()
    *_, (label, points, lines) = look.drawn()
    assert label == "paper_lossy_links: robot ← whom it receives from"
    assert points > 1000
    assert lines == 4
    assert look.ask("document.querySelectorAll('#network svg').length") == 2
    assert not look.complaints()


def test_the_arms_animation_plays_and_stops(look):
    before, began = look.picture(), look.now()
    look.ask("document.querySelector('#play').click()")
    look.until("Number(document.querySelector('#slider').value) > 0.3")
    look.ask("document.querySelector('#play').click()")
    stopped, after = look.now(), look.picture()
    assert stopped > began
    assert after != before
    assert look.ask("new Promise(done => requestAnimationFrame(() => done('frame')))") == "frame"
    assert (look.now(), look.picture()) == (stopped, after)


def test_the_slider_goes_to_a_time(look):
    shown = set()
    for t in (0, 10, 20, 30):
        look.ask(
            "(slider => { slider.value = arguments[0]; slider.dispatchEvent(new Event('input')) })"
            "(document.querySelector('#slider'))",
            t,
        )
        assert look.ask("document.querySelector('#now').value") == f"{t:.2f} s"
        shown |= {look.picture("workspace"), look.picture("jointspace")}
    assert len(shown) == 8


def test_hiding_a_robot_hides_it_in_every_figure(look):
    def lines():
        return [lines for *_, lines in look.drawn()]

    all_lines, picture = lines(), look.picture("jointspace")
    chip = "[...document.querySelectorAll('#groups button')].find(b => b.innerText === 'robot 2')"
    look.ask(f"{chip}.click()")
    assert lines() == [n - 1 for n in all_lines[:8]] + all_lines[8:]
    assert look.picture("jointspace") != picture
    look.ask(f"{chip}.click()")
    assert lines() == all_lines
    assert look.picture("jointspace") == picture


def brightness(look):
    colour = look.ask("getComputedStyle(document.body).backgroundColor")
    return sum(map(int, re.findall(r"\d+", colour)[:3]))


def test_the_dark_scheme_follows_the_system_unless_switched(look):
    tick = "getComputedStyle(document.querySelector('.xtick text')).fill"
    light, light_tick, arms = brightness(look), look.ask(tick), look.picture()
    look.prefer(dark=True)
    look.until("document.documentElement.hasAttribute('data-dark')")
    assert brightness(look) < 150
    assert light > 600
    look.until(f"{tick} !== '{light_tick}'")
    assert look.picture() != arms
    for chosen, dark in (("light", False), ("dark", True), ("auto", True)):
        look.ask(
            "(theme => { theme.value = arguments[0]; theme.dispatchEvent(new Event('change')) })"
            "(document.querySelector('#theme'))",
            chosen,
        )
        assert (brightness(look) < 150) == dark
    look.prefer(dark=False)
    look.until("!document.documentElement.hasAttribute('data-dark')")
    assert not look.complaints()


def test_on_a_phone_nothing_is_too_small_or_off_screen(chromium, address):
    look = Look(chromium, address, width=390).ready()
    assert look.ask("document.documentElement.scrollWidth") <= 390
    smallest = look.ask(
        "Math.min(...[...document.querySelectorAll('body *')]"
        ".filter(e => [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim())"
        " && e.getClientRects().length && !['SUB', 'SCRIPT', 'tspan'].includes(e.tagName)"
        " && !e.closest('svg.main-svg .infolayer .legend'))"
        ".map(e => parseFloat(getComputedStyle(e).fontSize)))"
    )
    assert smallest >= 16
    assert all(lines for *_, lines in look.drawn())
    out_of_sight = look.ask(
        "(names => { document.querySelector('#figures section').append(plots.chooser("
        "names.map((joint_name, joint) => ({ joint, joint_name }))));"
        " return [...document.querySelectorAll('button, h3, td:is(.holds, .within), .stacked td')]"
        ".filter(e => e.getBoundingClientRect().right > 390).map(e => e.innerText)"
        " })(arguments[0])",
        ["q", "workcell_left_arm_gripper_left_finger_slide_joint", "w" * 80],
    )
    assert out_of_sight == []
    assert look.ask("document.documentElement.scrollWidth") <= 390
    assert look.ask("document.querySelectorAll('.within').length") >= 4
    look.size(1280)
    assert not look.complaints()


def test_a_logarithmic_axis_has_two_ticks_at_least_in_full_numbers(look):
    axes = look.ask(
        "(async ranges => { const found = []; for (const y_range of ranges) {"
        " const panel = { logarithmic: true, y_range, rows: [], labels: [], curves: [] };"
        " const plot = document.body.appendChild(make('div', { className: 'plot' }));"
        " await Plotly.newPlot(plot, [{ x: [0, 1], y: y_range }], plots.layout({ panel, plot }));"
        " found.push([...plot.querySelectorAll('.ytick text')]"
        ".map(e => [Number(e.textContent.replace('−', '-')), e.__data__.x])); plot.remove() }"
        " return found })(arguments[0])",
        [
            [0.08, 1.6],
            [0.31, 2.6],
            [1.1, 1.3],
            [0.9, 9.5],
            [0.9, 11],
            [0.3, 40],
            [0.07, 130],
            [1e-7, 3],
        ],
    )
    for ticks in axes:
        assert len(ticks) >= 2
        shown, powers = np.transpose(ticks)
        np.testing.assert_allclose(shown, 10**powers, rtol=1e-6)


def test_a_live_page_says_that_it_goes_on_before_its_plots_are_drawn(look):
    assert look.ask(
        "(async () => { let told; const known = page.runs;"
        " fetch = async () => ({ status: 200, headers: new Headers(), json: async () =>"
        " ({ runs: known }) });"
        " render = async () => { told = ['#told', '#left'].map(e => $(e).textContent);"
        " told.push($('#progress').value) };"
        " await follow(null); return told })()"
    ) == ["Live: the run is completed.", "30 of 30 s simulated", 300]


def test_a_recording_without_a_tick_is_shown(chromium, empty, folder):
    (folder / "empty.html").write_text(page([story(empty)]), "utf-8")
    look = Look(chromium, (folder / "empty.html").as_uri()).ready()
    assert "0 of 300 sampling times" in look.ask("document.body.innerText")
    assert look.ask("document.querySelector('#motion').hidden")
    assert not look.complaints()
