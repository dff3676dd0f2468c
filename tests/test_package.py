"""What is installed has one name, and works away from the tree, beside a user's own modules."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import nrs_cosim
from docs.licences import rows
from tests.release import built, chosen

ROOT = Path(__file__).parents[1]
ROOMS = ("bus", "estimator_agents", "orchestrator", "plant_fmu", "recordings")
THEIRS = "raise ImportError('this module is the user\\'s own')\n"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder that a wheel of the sdist is unpacked into, as an installer does."""
    folder = tmp_path_factory.mktemp("package")
    _, wheel = built(folder)
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_a_wheel_of_the_sdist_holds_one_name_and_every_file_of_the_tree(site):
    names = {path.name for path in site.iterdir() if not path.name.endswith(".dist-info")}
    assert names == {"nrs_cosim"}
    tracked = subprocess.run(
        ["git", "ls-files", "nrs_cosim/*.py", "nrs_cosim/py.typed", *ROOMS],
        cwd=ROOT, capture_output=True, text=True, check=False,
    ).stdout.split()  # fmt: skip
    if not tracked:
        pytest.skip("this tree is not a checkout, so there is no list of its files")
    inside = {path.relative_to(site).as_posix() for path in site.glob("nrs_cosim/**/*.*")}
    expected = {path if path.startswith("nrs_cosim/") else f"nrs_cosim/{path}" for path in tracked}
    assert inside == expected


def test_a_users_modules_with_the_names_of_our_folders_do_not_clash(site, tmp_path):
    for room in ROOMS:
        (tmp_path / f"{room}.py").write_text(THEIRS, "utf-8")
    (tmp_path / "script.py").write_text(
        "import nrs_cosim\n"
        "from nrs_cosim.recordings import Recording\n"
        "with Recording('run.mcap') as recording:\n"
        "    print(nrs_cosim.__file__, recording.status, recording.digest)\n",
        "utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": str(site)}

    def said(*command: str) -> str:
        done = subprocess.run(
            [sys.executable, *command],
            cwd=tmp_path, env=environment, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    scenario = str(ROOT / "scenarios/paper_first_order.toml")
    said("-m", "nrs_cosim", "run", scenario, "-o", "run.mcap", "--workers", "2", "--threads", "2")
    file, status, digest = said("script.py").split()
    assert Path(file) == site / "nrs_cosim/__init__.py"
    assert (status, digest[:8]) == ("completed", "5433c658")


SCRIPT = (ROOT / "tests/user_script.py").read_text("utf-8")


def test_a_users_script_with_every_public_name_runs(site, tmp_path):
    assert {name for name in nrs_cosim.__all__ if f"nrs.{name}" not in SCRIPT} == set()
    (tmp_path / "script.py").write_text(SCRIPT, "utf-8")
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    done = subprocess.run(
        [sys.executable, "script.py"],
        cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(site)},
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.splitlines()[-1] == "run.mcap"


def test_every_dependency_has_a_licence_that_a_person_has_looked_at_and_stands_on_the_page():
    page = (ROOT / "docs/licences.md").read_text("utf-8")
    installed = [(name, text, core) for name, text, core in rows() if text is not None]
    assert {"casadi", "eclipse-zenoh", "fmpy", "numpy"} <= {name for name, *_ in installed}
    for name, text, core in installed:
        assert f"| {name} | {text} | {'yes' if core else ''} |\n" in page


def test_a_release_says_which_pythons_it_leaves_out_and_why(tmp_path):
    for name, does in {"old": "echo 3 9 18", "broken": "exit 127", "new": "echo 3 13 0"}.items():
        (tmp_path / name).write_text(f"#!/bin/sh\n{does}\n", "utf-8")
        (tmp_path / name).chmod(0o755)
    old, broken, new, gone = (str(tmp_path / n) for n in ("old", "broken", "new", "gone"))
    found, left = chosen([old, broken, new, new, gone])
    assert found == {new: "3.13.0"}
    assert left == [
        f"{old}: skipped, 3.9.18 is older than 3.11",
        f"{broken}: skipped, it does not start",
        f"{new}: skipped, 3.13.0 is one more of the same minor version",
        f"{gone}: skipped, it does not start",
        *(f"Python 3.{m}: not tried, none among those given" for m in (11, 12, 14)),
    ]
