"""A shell completes commands, options and values of `nrs`, as a user's own shell does with Tab."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.guard import GUARD

BIN = Path(sys.executable).parent
COMPLETED = {
    "nrs che": ["check"],
    "nrs re": ["recover", "replay", "report", "resume"],
    "nrs fmu b": ["build"],
    "nrs check --stri": ["--strict"],
    "nrs export --format ": ["csv", "mat", "nc", "parquet", "ssp"],
}
SHELLS = {
    "bash": """
source "$1"
COMP_WORDS=($2); [[ $2 == *' ' ]] && COMP_WORDS+=("")
COMP_CWORD=$(( ${#COMP_WORDS[@]} - 1 ))
_nrs_completion nrs
printf '%s\\n' "${COMPREPLY[@]}"
""",
    "zsh": """
compdef() { completes=$2 }
_arguments() { print -l -- "$@" }
source "$1"
[[ $completes == nrs ]] || exit 1
words=(${=2}); [[ $2 == *' ' ]] && words+=("")
CURRENT=${#words}
_nrs_completion
""",
    "fish": 'source $argv[1]; complete --do-complete "$argv[2]"',
}


def run(*command, **more):
    env = {**os.environ, "PATH": f"{BIN}:{os.environ['PATH']}", **more}
    return subprocess.run(
        command, env=env, check=False, capture_output=True, text=True, timeout=GUARD
    )


@pytest.fixture(params=SHELLS)
def shell(request):
    """Return the name of a shell that is here."""
    if not shutil.which(request.param):
        pytest.skip(f"{request.param} is not installed")
    return request.param


@pytest.mark.parametrize("line", COMPLETED)
def test_a_command_line_is_completed(shell, line, tmp_path):
    script = tmp_path / "completion"
    # The shell that asks is found among the parents of the command; what follows keeps it there.
    shown = run(shell, "-c", "nrs --show-completion; exit")
    assert shown.returncode == 0, shown.stderr
    script.write_text(shown.stdout, "utf-8")
    (tmp_path / "complete").write_text(SHELLS[shell], "utf-8")
    done = run(shell, str(tmp_path / "complete"), str(script), line)
    assert (done.returncode, done.stderr) == (0, "")
    found = [word for word in COMPLETED[line] if word in done.stdout]
    assert found == COMPLETED[line]
    if shell == "bash":
        assert sorted(done.stdout.split()) == COMPLETED[line]


def test_bash_loads_the_installed_completion(tmp_path):
    installed = run("bash", "-c", "nrs --install-completion; exit", HOME=str(tmp_path))
    assert installed.returncode == 0, installed.stderr
    asked = run("bash", "--norc", "-c", "source ~/.bashrc; complete -p nrs", HOME=str(tmp_path))
    assert asked.stdout == "complete -o default -F _nrs_completion nrs\n"


def test_a_shell_start_file_that_is_not_text_is_reported(tmp_path):
    (tmp_path / ".bashrc").write_bytes(b"# \xff\n")
    done = run("bash", "-c", "nrs --install-completion; exit", HOME=str(tmp_path))
    assert done.returncode == 2
    assert done.stderr.startswith("error: --install-completion: the shell's start file is no text")
    assert (tmp_path / ".bashrc").read_bytes() == b"# \xff\n"
