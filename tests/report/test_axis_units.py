"""An axis of one joint has that joint's unit; a number over joints has one only if all share it."""

import json
import re

import pytest
from typer.testing import CliRunner

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import ESTIMATE, Field, Sizes
from nrs_cosim.orchestrator.cli.main import app
from nrs_cosim.recordings.metadata import RUN
from nrs_cosim.recordings.report.page import page_data
from nrs_cosim.recordings.units import UNKNOWN
from tests.orchestrator.test_assets import again
from tests.recordings.made_up_runs import recorded
from tests.report.conftest import story

BOTH = "rad and m, rad/s and m/s"


@pytest.mark.parametrize(
    ("groups", "by_joint", "over_all"),
    [
        (["rad rad"], "(rad) (rad) (rad/s) (rad/s)", "rad, rad/s"),
        (["m m"], "(m) (m) (m/s) (m/s)", "m, m/s"),
        (["rad m", "rad m"], "(rad) (m) (rad/s) (m/s)", BOTH),
        (["rad m", "rad rad"], "(rad) (rad and m) (rad/s) (rad/s and m/s)", BOTH),
        (["rad ?"], "(rad) () (rad/s) ()", "mixed units, mixed units"),
        (["? ?", "? ?"], "() () () ()", "unit not known, unit not known"),
    ],
    ids=["turning", "sliding", "both", "of unlike robots", "one is not known", "none is known"],
)
def test_axes_show_the_unit_of_their_joint_and_norms_that_of_all(
    tmp_path, groups, by_joint, over_all
):
    def with_units(records):
        (plant,) = json.loads(records[RUN]["plants"])
        plants = [
            {
                **plant,
                "robots": [*range(robot, 3, len(groups))],
                "joints": [{"name": "", "unit": unit.strip("?")} for unit in units.split()],
            }
            for robot, units in enumerate(groups, 1)
        ]
        return {**records, RUN: {**records[RUN], "plants": json.dumps(plants)}}

    codecs = Codecs.of(Sizes(2), "Mine", kept={**ESTIMATE, "pull": Field(truth="position")})
    recorded(tmp_path / "made.mcap", n=2, m=2, ticks=3, codecs=codecs)
    path = again(tmp_path / "made.mcap", tmp_path / "a.mcap", records=with_units)
    data = page_data([story(path)])

    def shown(name):
        (panels,) = (f["panels"] for f in data["figures"] if f["name"] == name)
        return [(re.findall(r"\((.*?)\)$", panel["label"]) or [""])[0] for panel in panels]

    alone = re.findall(r"\((.*?)\)", by_joint)
    assert shown("estimates") == shown("tracking") == alone
    assert shown("agent_states") == ["" if " and " in unit else unit for unit in alone[:2]]
    overall = over_all.split(", ") * 2
    assert shown("envelopes") == [unit.replace(UNKNOWN, "") for unit in overall]
    assert [tile["unit"] for tile in data["runs"][0]["measured"]] == overall
    assert data["runs"][0]["unit"] == overall[0]
    printed = CliRunner().invoke(app, ["info", str(path)]).output
    assert ("in the last fifth (rad and m)" in " ".join(printed.split())) == (over_all == BOTH)
