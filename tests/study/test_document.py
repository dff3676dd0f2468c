"""What docs/studies.md shows is run, and true."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

from tests.command import nrs

ROOT = Path(__file__).parents[2]
DOCUMENT = (ROOT / "docs/studies.md").read_text("utf-8")


def test_the_sessions_print_what_is_shown_and_the_program_too(tmp_path):
    (tmp_path / "scenarios").symlink_to(ROOT / "scenarios")
    for session in re.findall(r"```console\n(.*?)```", DOCUMENT, re.DOTALL):
        for block in re.split(r"^\$ ", session, flags=re.MULTILINE)[1:]:
            line, *expected = block.splitlines()
            done = nrs(*shlex.split(line)[1:], cwd=tmp_path)
            assert done.returncode == 0, done.stderr
            assert [one.rstrip() for one in done.stdout.splitlines()] == expected
    ((program, expected),) = re.findall(r"```python\n(.*?)```\s*```\n(.*?)```", DOCUMENT, re.DOTALL)
    (tmp_path / "program.py").write_text(program, "utf-8")
    done = subprocess.run(
        [sys.executable, "program.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout == expected
