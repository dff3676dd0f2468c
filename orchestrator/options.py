"""How a run's sessions are reached, as options that several commands share."""

from pathlib import Path
from typing import Annotated

import typer

from bus.certificates import Tls
from bus.errors import InputError
from orchestrator.scenario import TlsTable

_PANEL = "Beyond this machine"

Listen = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ENDPOINT",
        rich_help_panel=_PANEL,
        help="Where hosts meet, such as tls/0.0.0.0:7447; may be given again.",
    ),
]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        metavar="ENDPOINT",
        rich_help_panel=_PANEL,
        help="Where to meet, such as tls/lab.example:7447; may be given again.",
    ),
]
InsecureTcp = Annotated[
    bool,
    typer.Option(
        "--insecure-tcp",
        rich_help_panel=_PANEL,
        help="Allow plain TCP beyond this machine, where anyone may listen and speak.",
    ),
]
TlsCa = Annotated[
    Path | None,
    typer.Option(
        "--tls-ca",
        metavar="FILE.pem",
        rich_help_panel=_PANEL,
        help="Certificate of the authority that all hosts of a run share.",
    ),
]
TlsCertificate = Annotated[
    Path | None,
    typer.Option(
        "--tls-certificate",
        metavar="FILE.pem",
        rich_help_panel=_PANEL,
        help="Own certificate; its common name is the host's name.",
    ),
]
TlsKey = Annotated[
    Path | None,
    typer.Option(
        "--tls-key",
        metavar="FILE.pem",
        rich_help_panel=_PANEL,
        help="Private key of the certificate, without a passphrase.",
    ),
]


def tls_of(
    ca: Path | None,
    certificate: Path | None,
    key: Path | None,
    table: TlsTable | None = None,
    folder: Path = Path(),
) -> Tls | None:
    """Return the certificates that were given; an option goes before the scenario's table.

    Paths of the table are relative to `folder`. None without any; `InputError` when only some of
    the three are given.
    """
    given = {"ca": ca, "certificate": certificate, "key": key}
    if table is not None:
        for name, path in given.items():
            given[name] = folder / getattr(table, name) if path is None else path
    missing = [f"--tls-{name}" for name, path in given.items() if path is None]
    if len(missing) == len(given):
        return None
    if missing:
        raise InputError(
            f"{' and '.join(missing)}: missing; certificate, key and authority go together"
        )
    return Tls(**{name: path for name, path in given.items() if path is not None})
