"""What docs/urdf.md shows is run, and true."""

import re
import shlex
from pathlib import Path

import pytest

from tests.command import nrs

ROOT = Path(__file__).parents[2]
DOCUMENT = (ROOT / "docs/urdf.md").read_text("utf-8")


def test_the_sessions_print_what_is_shown(tmp_path):
    """A line of dots stands for others, and none but they are left out."""
    pytest.importorskip("casadi", reason="needs the packages of the extra urdf")
    (tmp_path / "lbr_iiwa_14.urdf").symlink_to(ROOT / "tests/plant_fmu/robots/lbr_iiwa_14.urdf")
    ((scenario),) = re.findall(r"```toml\n(.*?)```", DOCUMENT, re.DOTALL)
    (tmp_path / "arms.toml").write_text(scenario, "utf-8")
    sessions = re.findall(r"```console\n\$ (.*?)\n(.*?)```", DOCUMENT, re.DOTALL)
    assert len(sessions) == 3
    for line, shown in sessions:
        done = nrs(*shlex.split(line)[1:], cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        parts = [re.escape(part) for part in shown.split("…\n")]
        printed = "".join(f"{one.rstrip()}\n" for one in done.stdout.splitlines())
        assert re.fullmatch("(?s:.*?)".join(parts), printed), printed
