"""The command `nrs`: every error is shown here once, and decides the exit status.

0 done; 1 the run failed, with who and when; 2 the input is bad, with the field and the value;
130 interrupted, with the recording closed and valid.

A module `*_commands` declares commands and their options, and is loaded when one of them is asked
for; what it does is loaded when it is called, for a user waits for all that is loaded.
"""

import logging
from errno import ENAMETOOLONG
from functools import cache
from typing import Annotated, Any

import typer

from nrs_cosim.bus.errors import CosimError, InputError
from nrs_cosim.orchestrator.cli.group import Commands
from nrs_cosim.orchestrator.exit_status import BAD_INPUT, FAILED
from nrs_cosim.orchestrator.logs import Level, log_to_standard_error
from nrs_cosim.orchestrator.terminal import Warnings, out, say

app = typer.Typer(
    name="nrs",
    cls=Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},  # of every command below as well
    pretty_exceptions_enable=False,
)


def _print_version(asked: bool) -> None:
    if asked:
        from importlib.metadata import version as installed

        out.print(f"nrs-cosim {installed('nrs-cosim')}")
        raise typer.Exit


@app.callback()
def nrs(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", is_eager=True, callback=_print_version, help="Print the version."
        ),
    ] = False,
    log_level: Annotated[
        Level | None,
        typer.Option(
            help="Log workers, their coordinator and the live page to standard error, with times."
        ),
    ] = None,
) -> None:
    """Co-simulate networked robots under sampled interaction."""
    import numpy as np

    if log_level:
        log_to_standard_error(log_level)

    np.seterr(all="ignore")  # what is not finite is looked for and named, not warned of


@cache  # a command line in this process is followed by others
def command() -> Any:
    """Return all commands, with their options."""
    return typer.main.get_command(app)


def main() -> None:
    """Run the command line and exit with its status."""
    logging.getLogger("nrs").handlers = [Warnings(logging.WARNING)]
    try:
        command()()
    except OSError as error:
        say("red", "error", str(error))
        raise SystemExit(BAD_INPUT if error.errno == ENAMETOOLONG else FAILED) from None
    except (RuntimeError, MemoryError) as error:
        if isinstance(error, RuntimeError) and str(error) != "can't start new thread":
            raise
        said = str(error) or "out of memory"
        say("red", "error", f"{said}: raise the limit: `ulimit -u`, `ulimit -v`, or a container's")
        raise SystemExit(FAILED) from None
    except CosimError as error:
        say("red", "error", str(error))
        raise SystemExit(BAD_INPUT if isinstance(error, InputError) else FAILED) from None
