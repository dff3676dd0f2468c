"""The certificates that a command is given: by options, else by the scenario."""

from pathlib import Path

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.network.certificates import Tls
from nrs_cosim.orchestrator.scenario.tables.scenario import TlsTable


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
