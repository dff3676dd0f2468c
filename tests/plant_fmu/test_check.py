"""An FMU is checked before a run: ours pass, wrong mechanics are found, a crash is a finding."""

import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from nrs_cosim.plant_fmu.archives.archive import open_archive
from nrs_cosim.plant_fmu.bundled.builder import build, build_model
from nrs_cosim.plant_fmu.bundled.declaration import MODELS, declaration
from nrs_cosim.plant_fmu.checking.budget import Budget
from nrs_cosim.plant_fmu.checking.findings import CheckTask, FmuCheck
from nrs_cosim.plant_fmu.checking.procedure import findings
from nrs_cosim.plant_fmu.checking.subprocess_check import check
from nrs_cosim.plant_fmu.drives.choice import Driving
from nrs_cosim.plant_fmu.plants import Body, Disturbance
from tests.cases import cases
from tests.command import nrs
from tests.guard import LIMIT
from tests.plant_fmu.rewritten_fmus import renamed, rewritten

pytestmark = [
    pytest.mark.skipif(shutil.which("cc") is None, reason="needs a C compiler"),
    pytest.mark.filterwarnings("ignore::RuntimeWarning"),
]

PHYSICS = ("rate", "M symmetric", "M positive definite", "rests", "power")


def statuses(checked, topic="physics"):
    return {f.name: f.status for f in checked.findings if f.topic == topic}


def found(checked, name):
    (finding,) = (f for f in checked.findings if f.name == name)
    return finding


def changed(path, model, *edits):
    """Build a bundled model with edits (old, new) of its equations, as a stranger's FMU."""
    text = (MODELS / model / "model.c").read_text()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NRS_CACHE", str(path))
        return build_model(declaration(model), {"model.c": text.encode()})


@pytest.mark.parametrize("fmi", [2, 3])
@pytest.mark.parametrize("model", ["two_link_arm", "n_link_arm", "planar_robot"])
def test_bundled_models_obey_mechanics(model, fmi):
    checked = check(CheckTask(open_archive(build(model, fmi))))
    assert checked.passes
    assert statuses(checked) == dict.fromkeys(PHYSICS, "holds")
    assert statuses(checked, "drives")["chosen"] == "holds"
    assert statuses(checked, "loads") == {"CoSimulation": "holds", "ModelExchange": "holds"}
    power = found(checked, "power")
    assert power.text.startswith("loses energy" if model == "planar_robot" else "energy is kept")


def test_damping_agrees_with_the_closed_form():
    """Of m v̇ = −d v the power is −d v'v, beside v'mv / s: −0.5 / (0.5 + 2)."""
    power = found(check(CheckTask(open_archive(build("planar_robot")))), "power")
    np.testing.assert_allclose(power.value, -0.2, rtol=1e-6)


@pytest.mark.parametrize("solver", cases([None, "rk4"], ["rk4"]))
@pytest.mark.parametrize(
    ("model", "old", "new", "fails"),
    [
        ("planar_robot", "/ p->m", "/ -p->m", "M positive definite"),
        ("two_link_arm", "qdd[0] = (M22 * f1 - M12", "qdd[0] = (M22 * f1 + M12", "M symmetric"),
        ("two_link_arm", "C2 = b", "C2 = 1.5 * b", "power"),
        ("planar_robot", "- p->d", "+ p->d", "power"),
    ],
)
def test_wrong_mechanics_are_found(tmp_path, model, old, new, fails, solver):
    archive = open_archive(changed(tmp_path, model, (old, new)))
    m = np.zeros(2)
    body = Body(1, {}, np.eye(2), np.eye(2), Disturbance(m, m, *np.zeros((3, 2, 0))), m, m, m, m)
    task = CheckTask(archive, body, driving=Driving(solver=solver))
    checked = FmuCheck(archive.label, archive.sha256, tuple(findings(task, Budget())))
    assert not checked.passes
    assert [name for name, status in statuses(checked).items() if status == "fails"] == [fails]


def test_a_crash_is_a_finding_after_the_earlier_ones(tmp_path):
    crash = changed(tmp_path, "planar_robot", ("(void)q;", "if (q[0] != 0.0) __builtin_trap();"))
    command = [sys.executable, "-m", "nrs_cosim.orchestrator", "fmu", "check", crash, "--json"]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 1
    assert not done.stderr
    *before, last = json.loads(done.stdout)["findings"]
    assert {f["topic"] for f in before} == {"valid", "loads", "variables", "drives"}
    assert last["status"] == "fails"
    assert "crashed with SIG" in last["text"]
    assert "after drives: chosen" in last["text"]


@pytest.mark.parametrize(
    ("act", "ending"),
    [("exit(0);", "exited with status 0"), ("for (;;) {}", f"did not return within {LIMIT:g} s")],
)
def test_an_exit_or_a_hang_is_a_finding(tmp_path, act, ending):
    path = changed(
        tmp_path,
        "planar_robot",
        ('#include "robot.h"', '#include <stdlib.h>\n#include "robot.h"'),
        ("(void)q;", f"if (q[0] != 0.0) {{ {act} }}"),
    )
    assert ending in check(CheckTask(open_archive(path)), deadline=LIMIT).findings[-1].text


LIES = {
    "more state than it saves": (
        "two_link_arm/model.c",
        ('#include "robot.h"', '#include "robot.h"\nstatic double warmth;'),
        ("C2 = b", "C2 = (1.0 + (warmth += 1e-9)) * b"),
    ),
    "a start in place of its state": (
        "saved_state.c",
        (
            "    memcpy(bytes, state, sizeof(State));",
            "    memcpy(bytes, state, sizeof(State));\n"
            "    ((State *)bytes)->values.q[0] = start_values[0];",
        ),
    ),
    "a pointer": (
        "saved_state.c",
        (
            "    memcpy(bytes, state, sizeof(State));",
            "    State *kept = malloc(sizeof(State));\n"
            "    memcpy(kept, state, sizeof(State));\n"
            "    memset(bytes, 0, size);\n"
            "    memcpy(bytes, &kept, sizeof kept);",
        ),
        ("    memcpy(&copy, bytes, sizeof copy);",
         "    const State *kept;\n"
         "    memcpy(&kept, bytes, sizeof kept);\n"
         "    memcpy(&copy, kept, sizeof copy);"),
    ),
}  # fmt: skip


@pytest.mark.parametrize("lie", cases([*LIES], [*LIES][:1]))
def test_an_incomplete_fmu_state_is_found(tmp_path, lie):
    models = tmp_path / "models"
    shutil.copytree(MODELS, models)
    name, *edits = LIES[lie]
    text = (models / name).read_text()
    for old, new in edits:
        assert old in text
        text = text.replace(old, new)
    (models / name).write_text(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NRS_CACHE", str(tmp_path))
        patch.setattr("nrs_cosim.plant_fmu.bundled.declaration.MODELS", models)
        patch.setattr("nrs_cosim.plant_fmu.bundled.builder.MODELS", models)
        path = build("two_link_arm")
    checked = check(CheckTask(open_archive(path)))
    resumed = found(checked, "resumed")
    assert resumed.status == "fails"
    assert found(checked, "alone").status == "holds"
    if lie == "a pointer":
        assert "robot 1: the FMU crashed with SIGSEGV, in deserialize" in resumed.text
    else:
        assert resumed.text.endswith("it has more state than it saves")
        assert resumed.value > 0


@pytest.mark.parametrize("solver", [None, "cvode"])
def test_a_complete_fmu_state_is_confirmed(solver):
    m = np.zeros(2)
    body = Body(1, {}, np.eye(2), np.eye(2), Disturbance(m, m, *np.zeros((3, 2, 0))), m, m, m, m)
    task = CheckTask(open_archive(build("planar_robot", 2)), body, driving=Driving(solver=solver))
    resumed = found(check(task), "resumed")
    assert (resumed.status, resumed.value) == ("holds", 0.0)


@pytest.mark.parametrize("fmi", [2, 3])
def test_a_missing_fmu_state_is_a_note(tmp_path, fmi):
    state = "state" if fmi == 2 else "State"
    claim = f'canSerializeFMU{state}="true"'

    def edit(text):
        assert claim in text
        return text.replace(claim, "")

    checked = check(CheckTask(open_archive(rewritten(tmp_path / "a.fmu", fmi, edit))))
    assert checked.passes
    assert found(checked, "resumed").status == "note"


def test_names_not_found_are_reported_with_what_to_write(tmp_path):
    def edit(text):
        return renamed(
            text,
            lambda stem, at: (
                f"phi_{at[0]}_" if stem == "q" else f"{stem}[{','.join(map(str, at))}]"
            ),
        )

    path = rewritten(tmp_path / "a.fmu", 2, edit)
    checked = check(CheckTask(open_archive(path)))
    assert statuses(checked, "drives")["chosen"] == "fails"
    assert 'variables.q = "its name"' in found(checked, "q").text
    mended = check(CheckTask(open_archive(path), names={"q": ("phi_1_", "phi_2_")}))
    assert mended.passes
    assert found(mended, "q").text == "phi_1_ (rad), phi_2_ (rad)"


def test_missing_variables_are_reported_once_where_needed(tmp_path):
    """Of theta, omega and u, first with no names given, then with those that are needed."""
    new = {"q": "theta", "qd": "omega", "tau": "u", "position_ref": "a", "velocity_ref": "b"}

    def edit(text):
        return renamed(text, lambda stem, at: new.get(stem, f"x{stem}") + "_".join(map(str, at)))

    path = rewritten(tmp_path / "a.fmu", 2, edit)
    plain = check(CheckTask(open_archive(path)))
    result = [f for f in plain.findings if f.topic in {"variables", "drives"}]
    assert sum("; it has " in f.text or "did you mean" in f.text for f in result) == 1
    assert found(plain, "tau").text == "not found either; write variables.tau as well, as of q"
    assert found(plain, "position_ref").text == "not there, nor needed: tau would do"
    assert "variables.q" not in found(plain, "chosen").text
    names = {ours: (f"{new[ours]}1", f"{new[ours]}2") for ours in ("q", "qd", "tau")}
    mapped = check(CheckTask(open_archive(path), names=names))
    assert found(mapped, "velocity_ref").text == "not there, nor needed: it takes tau"
    assert mapped.passes


def test_a_scenario_gives_the_check_names_gains_and_drive(tmp_path):
    paper = Path("scenarios/paper_first_order.toml")
    done = nrs("fmu", "check", "two_link_arm", "--json", "--scenario", paper)
    assert done.returncode == 0, done.stdout + done.stderr
    text = paper.read_text("utf-8")
    scenario = tmp_path / "s.toml"
    scenario.write_text(
        re.sub(r'fmu = "two_link_arm".*', 'fmu = "x.fmu"\nsolver = "rk4"\nstep = 0.001', text)
    )
    done = nrs("fmu", "check", "two_link_arm", "--json", "--scenario", scenario)
    (alone,) = (f for f in json.loads(done.stdout)["findings"] if f["name"] == "alone")
    assert alone["text"].startswith("1 s by Model Exchange, RK4 step 0.001 s: finite")


def test_check_as_json_has_each_finding():
    result = json.loads(nrs("fmu", "check", "planar_robot", "--json").stdout)
    assert set(result) == {"fmu", "sha256", "passes", "findings"}
    assert all(set(f) == {"topic", "name", "status", "text", "value"} for f in result["findings"])
    topics = list(dict.fromkeys(f["topic"] for f in result["findings"]))
    assert topics == ["valid", "loads", "variables", "drives", "physics", "runs"]


def test_fmu_check_exits_by_its_findings(tmp_path):
    good = nrs("fmu", "check", "planar_robot")
    assert good.returncode == 0
    assert "loses energy (damping)" in good.stdout
    negative = changed(tmp_path, "planar_robot", ("/ p->m", "/ -p->m"))
    bad = nrs("fmu", "check", negative)
    assert bad.returncode == 1
    assert re.search(
        r"M positive definite +does not hold +torque acts against its sign", bad.stdout
    )
    assert nrs("fmu", "check", "none.fmu").returncode == 2
    assert nrs("fmu", "check", "planar_robot", "--scenario", "none.toml").returncode == 2


def test_a_variable_of_another_type_with_the_reference_of_a_quantity_changes_nothing(tmp_path):
    other = (
        '<ScalarVariable name="mode" valueReference="{}" causality="parameter" '
        'variability="fixed"><Integer start="3"/></ScalarVariable></ModelVariables>'
    )
    plain = rewritten(tmp_path / "plain.fmu", 2, lambda text: text)
    reference = {v.name: v.valueReference for v in open_archive(plain).description.modelVariables}
    more = rewritten(
        tmp_path / "more.fmu",
        2,
        lambda text: text.replace("</ModelVariables>", other.format(reference["q[1]"])),
    )
    expected, got = (check(CheckTask(open_archive(path))) for path in (plain, more))
    assert expected.passes
    assert got.findings == expected.findings
