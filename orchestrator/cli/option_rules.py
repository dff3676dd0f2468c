"""An option that means nothing beside the others that were given is refused, never ignored.

A command declares its rules beside its options, by the names that a user writes. They are applied
to what was given, before the command begins.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.plurals import any_of

_Command = TypeVar("_Command", bound=Callable[..., None])
_ATTRIBUTE = "option_rules"


@dataclass(frozen=True, slots=True)
class OptionRules:
    """What options of a command require, which exclude one another, and of which one is needed."""

    requires: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """By option: others, of which one at least must be given."""
    excludes: Iterable[tuple[str, str]] = ()
    one_of: Iterable[tuple[str, ...]] = ()
    """Ways to use the command, of which exactly one is given; each by options that go together."""

    def __call__(self, command: _Command) -> _Command:
        """Return a command that has these rules."""
        setattr(command, _ATTRIBUTE, self)
        return command

    def expect(self, given: Collection[str]) -> None:
        """Raise `InputError` for the first option of those given that breaks a rule."""
        for option, owners in self.requires.items():
            if option in given and not any(owner in given for owner in owners):
                raise InputError(f"{option} requires {any_of(owners)}")
        for one, other in self.excludes:
            if one in given and other in given:
                raise InputError(f"{one} and {other} exclude one another; leave one of them out")
        ways = [*self.one_of]
        used = [found for way in ways if (found := [name for name in way if name in given])]
        if ways and len(used) != 1:
            names = ", ".join(name for found in used for name in found) or "none of them"
            known = any_of("/".join(way) for way in ways)
            raise InputError(f"expected exactly one of {known}, got {names}")


def required_by(owners: Iterable[str], *options: str) -> dict[str, tuple[str, ...]]:
    """Return the rules of options that all require one of the same others."""
    return dict.fromkeys(options, tuple(owners))


def rules_of(command: Any) -> OptionRules:
    """Return the rules of a command of Typer's; without any, none."""
    found = getattr(command.callback, _ATTRIBUTE, None)
    return found if isinstance(found, OptionRules) else OptionRules()


def given_on_command_line(ctx: Any) -> set[str]:
    """Return all names of the options that a command was given."""
    return {
        name
        for parameter in ctx.command.params
        if getattr(ctx.get_parameter_source(parameter.name), "name", "") == "COMMANDLINE"
        for name in parameter.opts
    }
