"""The terminal that all commands write to: results on its output, all else on its error."""

import json
import logging
import os
import sys
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.markup import escape

from nrs_cosim.bus.text import bounded

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON.")]


class Terminal(Console):
    """A console whose reader may go away, as `head` does: the command ends as if it had not."""

    def on_broken_pipe(self) -> None:
        """Write to nowhere from here on."""
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


out = Terminal(soft_wrap=True, highlight=False, emoji=False)
err = Terminal(soft_wrap=True, highlight=False, emoji=False, stderr=True)


def say(colour: str, kind: str, text: str) -> None:
    """Tell the user of an error, a warning or damage."""
    prose(err, f"[{colour}]{kind}:[/] {escape(bounded(text))}")


def prose(console: Console, markup: str) -> None:
    """Print sentences: a terminal's lines end between words, a pipe's where the text's do."""
    console.print(markup, soft_wrap=not console.is_terminal)


class Warnings(logging.Handler):
    """Tells the user what is logged, as a warning."""

    def emit(self, record: logging.LogRecord) -> None:
        """Tell one."""
        say("yellow", "warning", record.getMessage())


def print_json(value: Any) -> None:
    """Print a result for programs."""
    out.print(json.dumps(value, indent=2), markup=False)
