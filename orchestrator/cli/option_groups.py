"""Options that several commands have are declared once: as the fields of a group.

A command takes a group as one argument; its users, and Typer, see the fields as options.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, is_dataclass
from functools import partial, wraps
from inspect import Parameter, signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli.option_rules import required_by
from nrs_cosim.orchestrator.cli.options import (
    WAIT,
    Compressed,
    Connect,
    Deadline,
    Expect,
    Force,
    InsecureTcp,
    Listen,
    NoRestart,
    Output,
    Set,
    ShowProfile,
    Threads,
    TlsCa,
    TlsCertificate,
    TlsKey,
    Wait,
    Workers,
    changes_of,
)
from nrs_cosim.orchestrator.terminal import AsJson

if TYPE_CHECKING:
    from nrs_cosim.bus.network.certificates import Tls
    from nrs_cosim.orchestrator.engine.lockstep import Launcher
    from nrs_cosim.orchestrator.scenario.changes import Change
    from nrs_cosim.orchestrator.scenario.experiment import Experiment
    from nrs_cosim.orchestrator.scenario.tables.scenario import TlsTable


OF_OUTPUT = (("--profile", "--json"),)
"""What a run prints: one or the other."""
BEYOND = ("--listen", "--connect")
"""Options of a run whose workers are elsewhere."""
OF_WORKERS = {
    **required_by(("--workers", *BEYOND), "--wait", "--no-restart"),
    **required_by(BEYOND, "--expect", "--insecure-tcp"),
    **required_by(BEYOND, "--tls-ca", "--tls-certificate", "--tls-key"),
}
"""What options about workers, or about links to them, require of those of a run."""


@dataclass(frozen=True, slots=True)
class RunOptions:
    """What of a scenario is changed, where the recording goes, and what is shown of it."""

    output: Output = None
    changes: Set = None
    as_json: AsJson = False
    force: Force = False
    compression: Compressed = "zstd"
    profile: ShowProfile = False

    def scenario_changes(self) -> "list[Change]":
        """Return what `--set` changes."""
        return changes_of(self.changes)


@dataclass(frozen=True, slots=True)
class TlsOptions:
    """Who one is to others."""

    tls_ca: TlsCa = None
    tls_certificate: TlsCertificate = None
    tls_key: TlsKey = None

    def certificates(self, table: "TlsTable | None" = None, folder: Path = Path()) -> "Tls | None":
        """Return the certificates that were given; an option goes before the scenario's table.

        Paths of the table are relative to `folder`. None without any; `InputError` when only some
        of the three are given.
        """
        names = ("ca", "certificate", "key")
        given = {name: getattr(self, f"tls_{name}") for name in names}
        if table is not None:
            own = {name: folder / getattr(table, name) for name in names}
            given = {name: path or own[name] for name, path in given.items()}
        missing = [f"--tls-{name}" for name, path in given.items() if path is None]
        if len(missing) == len(names):
            return None
        if missing:
            raise InputError(
                f"{' and '.join(missing)}: missing; certificate, key and authority go together"
            )
        from nrs_cosim.bus.network.certificates import Tls

        return Tls(**given)


@dataclass(frozen=True, slots=True)
class LinkOptions(TlsOptions):
    """How others are reached, and how long for."""

    wait: Wait = None
    insecure_tcp: InsecureTcp = False

    @property
    def seconds_to_wait(self) -> float:
        """How long to wait for one another, s."""
        return WAIT if self.wait is None else self.wait


@dataclass(frozen=True, slots=True)
class WorkerOptions(LinkOptions):
    """Who runs the robots of a run."""

    workers: Workers = None
    threads: Threads = None
    deadline: Deadline = None
    no_restart: NoRestart = False
    listen: Listen = None
    connect: Connect = None
    expect: Expect = 1

    def launcher(self, experiment: "Experiment") -> "Launcher":
        """Return how a run of an experiment gets its workers."""
        from nrs_cosim.bus.network.endpoints import Endpoints
        from nrs_cosim.orchestrator.cli.terminal_run import launcher_of, policy_of

        wait, tls = self.seconds_to_wait, experiment.scenario.bus.tls
        certificates = self.certificates(tls, experiment.folder)
        ends = partial(Endpoints, tls=certificates, insecure_tcp=self.insecure_tcp, wait=wait)
        policy = policy_of(self.no_restart, wait, self.expect, self.deadline)
        asked = self.workers, self.threads
        return launcher_of(experiment, *asked, policy, self.listen, self.connect, ends)


def with_groups(command: Callable[..., None]) -> Callable[..., None]:
    """Return a command whose groups' fields are options of its own, in the groups' place."""
    groups: dict[str, Any] = {}
    options: list[Parameter] = []
    for name, parameter in signature(command, eval_str=True).parameters.items():
        if is_dataclass(parameter.annotation):
            groups[name] = parameter.annotation
            options += _options_of(parameter.annotation)
        else:
            options.append(parameter.replace(kind=Parameter.KEYWORD_ONLY))

    @wraps(command)
    def call(**given: Any) -> None:
        for name, group in groups.items():
            given[name] = group(**{field.name: given.pop(field.name) for field in fields(group)})
        command(**given)

    call.__signature__ = signature(command).replace(parameters=options)  # type: ignore[attr-defined]
    # Typer looks here for what the signature does not say, and the command's own has the groups.
    call.__annotations__ = {option.name: option.annotation for option in options}
    return call


def _options_of(group: Any) -> Iterator[Parameter]:
    """Yield a group's fields as parameters, its own before those of the groups that it extends."""
    hints = get_type_hints(group, include_extras=True)
    defaults = {field.name: field.default for field in fields(group)}
    for of in group.__mro__[:-1]:
        for name in of.__annotations__:
            yield Parameter(
                name, Parameter.KEYWORD_ONLY, default=defaults[name], annotation=hints[name]
            )
