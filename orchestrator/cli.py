"""The command `nrs`: every error is shown here once, and decides the exit status.

0 done; 1 the run failed, with who and when; 2 the input is bad, with the field and the value;
130 interrupted, with the recording closed and valid.
"""

from contextlib import ExitStack
from importlib.metadata import version as installed
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from bus.errors import CosimError, InputError
from orchestrator import run_cli, showing
from orchestrator.checking import check as check_scenario
from orchestrator.doctor import diagnose
from orchestrator.fmu_cli import fmu
from orchestrator.options import (
    Listen,
    RecordingPath,
    ScenarioPath,
    TlsCa,
    TlsCertificate,
    TlsKey,
    tls_of,
)
from orchestrator.plants import group_by_archive, open_fleet
from orchestrator.report_cli import report
from orchestrator.scenario import json_schema
from orchestrator.scenario_file import read_scenario
from orchestrator.setting import bodies
from orchestrator.summary import describe, lines, measure
from orchestrator.terminal import AsJson, out, print_json, say
from recordings.export import export_csv
from recordings.reading import Reader

FAILED, BAD_INPUT = 1, 2

app = typer.Typer(
    name="nrs",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(fmu, name="fmu")


def _print_version(asked: bool) -> None:
    if asked:
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
) -> None:
    """Co-simulate networked robots under sampled interaction."""


app.command()(run_cli.run)
app.command()(run_cli.resume)
app.command()(run_cli.host)
app.command()(report)


@app.command()
def info(recording: RecordingPath, as_json: AsJson = False) -> None:
    """Say what a recording holds; also of one that was cut or never closed."""
    with Reader(recording) as reader:
        told = describe(reader)
        if as_json:
            print_json(told)
        else:
            showing.summary(out, lines(told, measure(reader)))
            for damage in reader.damage:
                say("yellow", "damage", damage)


@app.command()
def export(
    recording: RecordingPath,
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Where the tables go.")
    ],
) -> None:
    """Write a recording's samples and states as CSV tables."""
    with Reader(recording) as reader:
        for path in export_csv(reader, output):
            out.print(str(path), markup=False)
        for damage in reader.damage:
            say("yellow", "damage", damage)


@app.command()
def check(scenario: ScenarioPath, as_json: AsJson = False) -> None:
    """Say what the theory promises for a scenario, and whether its plants can be opened."""
    file = read_scenario(scenario)
    checked = check_scenario(file.scenario)
    with ExitStack() as stack:
        groups = group_by_archive(file.scenario, file.folder)
        open_fleet(stack, groups, bodies(file.scenario))
    if as_json:
        print_json(checked.as_json())
    else:
        showing.check(out, checked)


@app.command()
def doctor(
    listen: Listen = None,
    tls_ca: TlsCa = None,
    tls_certificate: TlsCertificate = None,
    tls_key: TlsKey = None,
    as_json: AsJson = False,
) -> None:
    """Try all that a run needs of this machine, and say what to do where something fails."""
    made = diagnose(listen or [], tls_of(tls_ca, tls_certificate, tls_key))
    if as_json:
        print_json(made.as_json())
    else:
        showing.diagnosis(out, made)
    raise typer.Exit(0 if made.fit else FAILED)


@app.command()
def schema() -> None:
    """Print the JSON schema of scenario files, for editors."""
    print_json(json_schema())


def main() -> None:
    """Run the command line and exit with its status."""
    np.seterr(all="ignore")  # what is not finite is looked for and named, not warned of
    try:
        app()
    except OSError as error:
        say("red", "error", str(error))
        raise SystemExit(FAILED) from None
    except CosimError as error:
        say("red", "error", str(error))
        raise SystemExit(BAD_INPUT if isinstance(error, InputError) else FAILED) from None
