"""The command `nrs` in the process of the tests: the same text and status, without a new start.

What a process is for, as signals and crashes, is tested with one.
"""

import sys
from contextlib import chdir, nullcontext, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess
from unittest.mock import patch

import numpy as np

from nrs_cosim.orchestrator.__main__ import main


def nrs(*arguments, cwd: Path | None = None) -> CompletedProcess[str]:
    """Run the command; return it done, with its output as text."""
    command = ["nrs", *map(str, arguments)]
    with (
        redirect_stdout(StringIO()) as printed,
        redirect_stderr(StringIO()) as errors,
        patch.object(sys, "argv", command),
        chdir(cwd) if cwd else nullcontext(),
        np.errstate(),  # which the command changes
    ):
        try:
            main()
            status = 0
        except SystemExit as ended:
            status = ended.code or 0
    return CompletedProcess(command, status, printed.getvalue(), errors.getvalue())
