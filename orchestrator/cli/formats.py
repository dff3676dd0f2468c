"""What a file is named, it is: the name's ending tells the format, and is never contradicted."""

from collections.abc import Sequence
from pathlib import Path

from nrs_cosim.bus.errors import InputError

_KINDS = {
    ".csv": "a table",
    ".fmu": "an FMU",
    ".html": "a page",
    ".json": "JSON",
    ".mat": "a table",
    ".mcap": "a recording",
    ".nc": "a netCDF file",
    ".parquet": "a table",
    ".pdf": "a PDF",
    ".png": "a picture",
    ".ssp": "a system",
    ".svg": "a picture",
    ".toml": "a scenario",
    ".urdf": "a URDF",
    ".xacro": "a URDF",
}


def format_of(output: Path, given: str | None, known: Sequence[str], option: str = "-o") -> str:
    """Return the format of a file: what its name ends in, or what was asked for beside it.

    Without either it is the first that is known. `InputError` where the two are at odds, or where
    the name ends in another kind of file.
    """
    ending = output.suffix.lower().removeprefix(".")
    if given is None:
        if ending and ending not in known:
            endings = ", ".join(f".{form}" for form in known)
            other = ", or --format" if option == "-o" else ""
            raise InputError(f"{option} {output}: expected a name that ends in {endings}{other}")
        return ending or known[0]
    if ending != given and f".{ending}" in _KINDS:
        raise InputError(f"--format {given}: -o {output} ends in .{ending}; leave one of them out")
    return given


def expect_ending(option: str, output: Path, ending: str) -> None:
    """Raise `InputError` for a file whose name ends as that of another kind."""
    kind = _KINDS.get(output.suffix.lower())
    if kind and output.suffix.lower() != ending:
        raise InputError(
            f"{option} {output}: is the name of {kind}, and {_KINDS[ending]} would be written; "
            f"give a name that ends in {ending}"
        )


_TABLES = "tables go into a folder; give the folder's name, and the format by --format"


def expect_folder_name(option: str, output: Path, instead: str = _TABLES) -> None:
    """Raise `InputError` for a folder whose name is that of a file, so that a file is meant."""
    kind = _KINDS.get(output.suffix.lower())
    if kind and not output.is_dir():
        raise InputError(f"{option} {output}: is the name of {kind}, and {instead}")
