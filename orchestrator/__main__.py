"""The command's entry: an interrupt while the modules load is an interrupt, not a traceback.

Whatever the encoding of the terminal or the pipe, a result can be printed.

Linear algebra has one thread unless the user says otherwise: where the processors have other work,
as those of a run's hosts have, more of them wait for one another by spinning.
"""

import os
import sys
from io import TextIOWrapper


def main() -> None:
    """Run `nrs`."""
    _print_anything()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from nrs_cosim.orchestrator.commands.cli import main as run  # noqa: PLC0415

        run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted: by the user\n")
        raise SystemExit(130) from None


def _print_anything() -> None:
    """Let the output take every character, as an escape where its encoding has none for it.

    A byte of a file's name that is no UTF-8 leaves as it came where the user's locale says so.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):
            as_it_came = stream.errors == "surrogateescape" and stream.encoding == "utf-8"
            stream.reconfigure(errors="surrogateescape" if as_it_came else "backslashreplace")


if __name__ == "__main__":
    main()
