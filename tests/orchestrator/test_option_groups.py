"""A group's fields are options of each command that takes it, with the same names and help."""

from dataclasses import dataclass, fields
from typing import Annotated, get_args

import typer
from typer.testing import CliRunner

from nrs_cosim.orchestrator.cli.main import command
from nrs_cosim.orchestrator.cli.option_groups import RunOptions, WorkerOptions, with_groups
from nrs_cosim.recordings.export import formats
from tests.command import nrs


@dataclass(frozen=True)
class Base:
    loud: Annotated[bool, typer.Option("--loud", help="Say it loud.")] = False


@dataclass(frozen=True)
class Extended(Base):
    times: Annotated[int, typer.Option(metavar="N", help="How often.")] = 1


def test_a_command_has_its_groups_options_in_their_place_and_gets_the_groups():
    given = []

    @with_groups
    def say(
        word: Annotated[str, typer.Argument()],
        *,
        first: Annotated[str, typer.Option()] = "a",
        group: Extended,
        last: Annotated[str, typer.Option()] = "z",
    ) -> None:
        given.append((word, first, group, last))

    app = typer.Typer(add_completion=False)
    app.command()(say)
    names = [option.name for option in typer.main.get_command(app).params]
    assert names == ["word", "first", "times", "loud", "last"]
    for arguments in (["hi"], ["hi", "--loud", "--times", "3", "--last", "y"]):
        assert CliRunner().invoke(app, arguments).exit_code == 0
    assert given == [("hi", "a", Extended(), "z"), ("hi", "a", Extended(True, 3), "y")]
    assert CliRunner().invoke(app, ["hi", "--times", "many"]).exit_code == 2


def test_run_and_resume_have_the_same_options():
    run, resume = (
        {name: one.opts for one in command().commands[which].params if (name := one.name)}
        for which in ("run", "resume")
    )
    shared = {field.name for group in (RunOptions, WorkerOptions) for field in fields(group)}
    assert {"output", "changes", "listen", "wait", "tls_ca"} <= shared
    assert {name: run[name] for name in shared} == {name: resume[name] for name in shared}


def test_export_takes_every_format_that_there_is():
    tables = get_args(formats.Format)
    done = nrs("export", "a.mcap", "-o", "a", "--format", "json")
    assert f"--format: expected {', '.join(tables)}, nc or ssp, got 'json'" in done.stderr
