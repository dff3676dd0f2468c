"""All commands as one group: what each does when it is interrupted, and how its help speaks.

An interrupt is told in a line and is exit status 130; wrong options are told in bounded sentences.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
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


def _nothing(ctx: Any) -> None:
    """Return no type."""


class Commands(TyperGroup):
    """All commands; each says so when it is interrupted."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        waiting: list[Any] = [self]
        for command in waiting:
            command.get_params = _without_types(command.get_params)
            command.invoke = _with_rules(command.invoke)
            waiting += getattr(command, "commands", {}).values()

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
