"""A worker opens its own robots only, wherever their FMUs are, and they move as with all others."""

import hashlib
from contextlib import ExitStack

import numpy as np
import pytest

from nrs_cosim.orchestrator.engine.plants import group_by_archive, open_fleet
from nrs_cosim.orchestrator.engine.units import mixed_units
from nrs_cosim.orchestrator.scenario import initial
from nrs_cosim.plant_fmu.archives.archive import Archive, open_archive
from nrs_cosim.plant_fmu.archives.units import si_name
from nrs_cosim.plant_fmu.bundled.builder import build
from nrs_cosim.plant_fmu.cache import keep_fmu, stored_fmu
from nrs_cosim.plant_fmu.errors import FmuError
from tests.command import nrs
from tests.scenarios import SHORT, paper, write

OWN = {
    "robots": [
        {"id": 2, "plant": {"fmu": "planar_robot"}},
        {"id": 5, "plant": {"fmu": "planar_robot"}, "initial": {"q": [1.5, -2]}},
    ]
}


def rows_of(groups):
    return {group.archive.label: group.rows for group in groups}


def test_rows_are_positions_among_the_robots_that_are_opened():
    file = paper(OWN)

    def rows(*robots):
        return rows_of(group_by_archive(file, robots))

    whole = rows_of(group_by_archive(file))
    assert whole == {"two_link_arm": [0, 2, 3, 5], "planar_robot": [1, 4]}
    assert rows(1, 2, 3, 4, 5, 6) == whole
    assert rows(2, 3, 5) == {"planar_robot": [0, 2], "two_link_arm": [1]}
    assert rows(4, 6) == {"two_link_arm": [0, 1]}
    assert rows() == {}


def test_a_worker_does_not_open_fmus_of_other_robots():
    file = paper({"robots": [{"id": 2, "plant": {"fmu": "none.fmu"}}]})
    group_by_archive(file, [1, 3])
    with pytest.raises(FmuError, match=r"^robots\[0\].plant: .*none.fmu: no such FMU"):
        group_by_archive(file, [2])


def test_robots_split_over_workers_move_as_in_one():
    file = paper(OWN)

    def played(robots=None):
        with ExitStack() as stack:
            groups = group_by_archive(file, robots)
            fleet = open_fleet(stack, groups, file.bodies(robots))
            estimate = file.initial_estimates(robots)
            fleet.hold(estimate.position, estimate.velocity)
            fleet.advance(0.0, 0.1)
            return np.stack([fleet.q, fleet.qd, fleet.tau], axis=1), fleet.save()

    states, saved = played()
    for robots in ([1, 2, 4], [3, 5, 6], [5]):
        rows = [robot - 1 for robot in robots]
        part, parts_saved = played(robots)
        np.testing.assert_array_equal(part, states[rows])
        assert parts_saved == [saved[row] for row in rows]


def test_initial_states_of_other_robots_are_not_drawn(monkeypatch):
    scenario, drawn, draw = paper(OWN), [], initial.draw

    def received(seed, purpose, robot, uniform, m):
        drawn.append((purpose, robot))
        return draw(seed, purpose, robot, uniform, m)

    whole = scenario.bodies()
    monkeypatch.setattr(initial, "draw", received)
    some = scenario.bodies([2, 5])
    names = ("q", "qd", "position", "velocity")
    assert sorted(drawn) == sorted(
        (name, robot) for name in names for robot in (2, 5) if (name, robot) != ("q", 5)
    )
    assert [body.robot for body in some] == [2, 5]
    for body in some:
        for name in names:
            assert getattr(body, name).tobytes() == getattr(whole[body.robot - 1], name).tobytes()


def test_given_initial_rows_belong_to_their_robots():
    rows = [[10.0 * robot, -1.0] for robot in range(1, 7)]
    scenario = paper({"initial.q": rows})
    assert [body.q.tolist() for body in scenario.bodies([2, 6])] == [[20, -1], [60, -1]]


def test_a_worker_finds_an_fmu_by_its_hash(tmp_path, monkeypatch):
    built = build("planar_robot")
    sha256 = hashlib.sha256(built.read_bytes()).hexdigest()
    monkeypatch.setenv("NRS_CACHE", str(tmp_path))
    keep_fmu(built.read_bytes(), sha256)
    file, asked = paper({"plant.fmu": "../elsewhere/my.fmu"}), []

    def find(fmu: str) -> Archive:
        asked.append(fmu)
        path = stored_fmu(sha256)
        assert path is not None
        return open_archive(path, fmu)

    (group,) = group_by_archive(file, [2, 3], find)
    assert asked == ["../elsewhere/my.fmu"]
    assert (group.archive.sha256, group.archive.label) == (sha256, "../elsewhere/my.fmu")
    assert not group.archive.ours


def test_a_fleet_of_mixed_units_lists_the_robots_of_each(tmp_path):
    result = "robots 1, 3-4, 6 in rad, robots 2, 5 in m; a number over all robots mixes them"
    assert mixed_units(paper(OWN)).endswith(result)
    scenario = write(tmp_path / "s.toml", OWN, SHORT)
    for command in (["check", scenario], ["run", scenario, "-o", tmp_path / "s.mcap"]):
        done = nrs(*command)
        assert done.returncode == 0, done.stderr
        assert result in done.stderr


@pytest.mark.parametrize(
    "robots",
    [
        [],
        [{"id": 2, "plant": {"parameters": {"m2": 3.0}}}],
        [{"id": 2, "plant": {"fmu": "n_link_arm", "parameters": {"n": 2}}}],
    ],
    ids=["alike", "of another mass", "of another model"],
)
def test_a_fleet_of_one_unit_gives_no_note(robots):
    assert mixed_units(paper({"robots": robots})) == ""


@pytest.mark.parametrize(
    ("name", "unit"), [("rad", "rad"), ("deg", "rad"), ("m", "m"), ("mm", ""), ("", ""), ("-", "")]
)
def test_a_unit_gives_the_si_unit_it_is_a_multiple_of(name, unit):
    assert si_name(name, [], ("rad", "m")) == unit
