"""The command `nrs`: every error is shown here once, and decides the exit status.

0 done; 1 the run failed, with who and when; 2 the input is bad, with the field and the value;
130 interrupted, with the recording closed and valid.

The modules `main` and `*_commands` declare commands and their options; what one does is loaded when
it is called, for a user waits for all that is loaded.
"""

import gc
import logging
from errno import ENAMETOOLONG
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import typer

from nrs_cosim.bus.errors import CosimError, InputError
from nrs_cosim.orchestrator.cli import recording_commands, replay_commands, run_commands
from nrs_cosim.orchestrator.cli.check_commands import check
from nrs_cosim.orchestrator.cli.convert_commands import convert
from nrs_cosim.orchestrator.cli.design_commands import design
from nrs_cosim.orchestrator.cli.fmu_commands import fmu
from nrs_cosim.orchestrator.cli.group import Commands
from nrs_cosim.orchestrator.cli.option_groups import TlsOptions, with_groups
from nrs_cosim.orchestrator.cli.option_rules import OptionRules
from nrs_cosim.orchestrator.cli.options import Listen
from nrs_cosim.orchestrator.cli.report_commands import report
from nrs_cosim.orchestrator.cli.study_commands import study, sweep
from nrs_cosim.orchestrator.exit_status import BAD_INPUT, DONE, FAILED
from nrs_cosim.orchestrator.logs import Level, log_to_standard_error
from nrs_cosim.orchestrator.terminal import AsJson, Warnings, err, out, print_json, say

COLLECTED = 100_000
"""New objects between searches for garbage: what is loaded stays, and is not searched each time."""

app = typer.Typer(
    name="nrs",
    cls=Commands,
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},  # of every command below as well
    pretty_exceptions_enable=False,
)
app.add_typer(fmu, name="fmu")
app.add_typer(study, name="study")


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


app.command()(run_commands.run)
app.command()(run_commands.resume)
app.command()(run_commands.worker)
app.command()(replay_commands.replay)
app.command()(replay_commands.diff)
app.command()(report)
app.command()(convert)
app.command()(design)
app.command()(sweep)
app.command()(recording_commands.info)
app.command()(recording_commands.export)
app.command()(recording_commands.recover)
app.command()(recording_commands.scene)
app.command()(check)


@app.command()
@with_groups
def doctor(*, listen: Listen = None, tls: TlsOptions, as_json: AsJson = False) -> None:
    """Test all that a run needs of this machine, and report what to do where something fails."""
    from nrs_cosim.orchestrator.cli import summary_text
    from nrs_cosim.orchestrator.cli.doctor import diagnose
    from nrs_cosim.orchestrator.cli.progress import stages

    with stages(err) as begin:
        made = diagnose(listen or [], tls.certificates(), begin)
    if as_json:
        print_json(made.as_json())
    else:
        summary_text.diagnosis(out, made)
    raise typer.Exit(DONE if made.fit else FAILED)


@app.command()
@OptionRules({"--messages": ("--output",), "--output": ("--messages",)})
def schema(
    messages: Annotated[
        bool,
        typer.Option("--messages", help="Write the .proto files of the messages of a run instead."),
    ] = False,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="DIR", help="Where the .proto files go."),
    ] = None,
) -> None:
    """Print the JSON schema of scenario files, for editors."""
    if messages and output:
        from nrs_cosim.orchestrator.cli.message_files import write_messages

        for path in write_messages(output):
            out.print(str(path), markup=False)
        return
    from nrs_cosim.orchestrator.scenario.tables.scenario import json_schema

    print_json(json_schema())


@cache  # a command line in this process is followed by others
def command() -> Any:
    """Return all commands, with their options."""
    return typer.main.get_command(app)


def main() -> None:
    """Run the command line and exit with its status."""
    gc.set_threshold(COLLECTED)
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
