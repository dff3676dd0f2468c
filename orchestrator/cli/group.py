"""All commands as one group: what each does when it is interrupted, and how its help speaks.

An interrupt is told in a line and is exit status 130; wrong options are told in bounded sentences.
A command, and the module that declares it, is loaded when it is asked for, all of them for help.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cache
from importlib import import_module
from itertools import islice, takewhile
from typing import Any

import typer
from typer.core import TyperArgument, TyperGroup

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.plurals import any_of
from nrs_cosim.bus.text import bounded, quoted
from nrs_cosim.orchestrator.cli.option_rules import given_on_command_line, rules_of
from nrs_cosim.orchestrator.exit_status import INTERRUPTED
from nrs_cosim.orchestrator.terminal import say

UsageError: Any = typer.BadParameter.__base__
"""Of click, or of Typer's own copy of it; only its subclass has a public name."""

_MODULE_OF: Mapping[str, str] = {
    "run": "run_commands",
    "resume": "run_commands",
    "worker": "run_commands",
    "replay": "replay_commands",
    "diff": "replay_commands",
    "report": "report_commands",
    "convert": "convert_commands",
    "design": "design_commands",
    "sweep": "study_commands",
    "info": "recording_commands",
    "export": "recording_commands",
    "recover": "recording_commands",
    "scene": "recording_commands",
    "check": "check_commands",
    "doctor": "setup_commands",
    "schema": "setup_commands",
    "fmu": "fmu_commands",
    "study": "study_commands",
}
"""What declares each command, in the order of the help."""

_WORD = r"'([^']*)'"
_CHOICE = re.compile(
    rf"(?:Value error, )?(['\"])(?P<given>.*)\1 is not one of (?P<known>{_WORD}(?:, {_WORD})*)\.$",
    re.DOTALL,
)
"""How Typer refuses a word that is none of those that an option takes."""


def _without_types(of: Callable[[Any], list[Any]]) -> Callable[[Any], list[Any]]:
    """Return what tells a command's parameters, with no type where a name or nothing says it."""

    def parameters(ctx: Any) -> list[Any]:
        found = of(ctx)
        for parameter in found:
            if isinstance(parameter, TyperArgument):
                parameter.display_type_rich = _nothing  # type: ignore[method-assign]
            elif getattr(parameter, "is_flag", False):
                parameter.metavar = ""
        return found

    return parameters


def _with_rules(invoke: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Return what calls a command, once its options are known to go together."""

    def ruled(ctx: Any) -> Any:
        rules_of(ctx.command).expect(given_on_command_line(ctx))
        return invoke(ctx)

    return ruled


def _with_values(parse: Callable[[Any, list[str]], Any]) -> Callable[[Any, list[str]], Any]:
    """Return what parses a command's arguments, where no option is taken for another's value."""

    def parsed(ctx: Any, args: list[str]) -> Any:
        options = {name: one for one in ctx.command.get_params(ctx) for name in one.opts}
        rest = iter(args)
        for arg in takewhile(lambda arg: arg != "--", rest):
            one = options.get(arg)
            if one is None or getattr(one, "is_flag", True):
                continue
            values = [*islice(rest, one.nargs)]
            if not options.keys().isdisjoint(values):
                wanted = one.metavar or "a value"
                raise InputError(f"{arg}: expected {wanted}, got {' '.join(map(quoted, values))}")
        return parse(ctx, args)

    return parsed


def _nothing(ctx: Any) -> None:
    """Return no type."""


def _prepare(command: Any) -> Any:
    """Return a command, as it and those below it are called and shown here."""
    waiting = [command]
    for one in waiting:
        one.get_params = _without_types(one.get_params)
        one.invoke = _with_rules(one.invoke)
        below = getattr(one, "commands", {}).values()
        if not below:
            one.parse_args = _with_values(one.parse_args)
        waiting += below
    return command


class _OnDemand(Mapping[str, Any]):
    """Commands by their names; each is loaded when it is first asked for."""

    def __init__(self) -> None:
        self._load = cache(_loaded)

    def __getitem__(self, name: str) -> Any:
        return self._load(name)

    def __iter__(self) -> Iterator[str]:
        return iter(_MODULE_OF)

    def __len__(self) -> int:
        return len(_MODULE_OF)


def _loaded(name: str) -> Any:
    """Return a command; `KeyError` where there is none of this name."""
    declared = getattr(import_module(f"{__package__}.{_MODULE_OF[name]}"), name)
    if not isinstance(declared, typer.Typer):
        declared, function = typer.Typer(add_completion=False), declared
        declared.command(name)(function)
    return _prepare(typer.main.get_command(declared))


class Commands(TyperGroup):
    """All commands; each says so when it is interrupted."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        _prepare(self)
        self.commands: Any = _OnDemand()

    def invoke(self, ctx: Any) -> Any:
        """Call the command that was given."""
        with _in_sentences():
            return super().invoke(ctx)

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Take the options before a command's name."""
        with _in_sentences():
            try:
                return super().parse_args(ctx, args)
            except UnicodeDecodeError as error:
                raise InputError(
                    f"--install-completion: the shell's start file is no text in UTF-8: {error}; "
                    "add what --show-completion prints to it"
                ) from None


@contextmanager
def _in_sentences() -> Iterator[None]:
    """Say that a command is interrupted, and bound what is said of wrong options."""
    try:
        yield
    except KeyboardInterrupt as interrupt:
        say("red", "interrupted", str(interrupt) or "by the user")
        raise typer.Exit(INTERRUPTED) from None
    except UsageError as error:
        if choice := _CHOICE.match(error.message):
            known, given = any_of(re.findall(_WORD, choice["known"])), quoted(choice["given"])
            raise InputError(f"{error.param.opts[0]}: expected {known}, got {given}") from None
        error.message = bounded(error.message)
        raise
