"""What a machine and an editor are made ready with: `doctor`, `schema`."""

from pathlib import Path
from typing import Annotated

import typer

from nrs_cosim.orchestrator.cli.option_groups import TlsOptions, with_groups
from nrs_cosim.orchestrator.cli.option_rules import OptionRules
from nrs_cosim.orchestrator.cli.options import Listen
from nrs_cosim.orchestrator.exit_status import DONE, FAILED
from nrs_cosim.orchestrator.terminal import AsJson, err, out, print_json


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
