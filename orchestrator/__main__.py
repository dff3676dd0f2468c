"""The command's entry: an interrupt while the modules load is an interrupt, not a traceback.

What asks a process to end (SIGTERM), and a terminal that is closed (SIGHUP), interrupt as Ctrl-C.

Results alone go to the standard output: what an FMU in this process prints there, as C code does,
goes to the standard error.

Whatever the encoding of the terminal or the pipe, a result can be printed.

Linear algebra has one thread unless the user says otherwise: where the processors have other work,
as those of a run's workers have, more of them wait for one another by spinning.
"""

import atexit
import gc
import os
import signal
import sys
from contextlib import suppress
from io import TextIOWrapper

from nrs_cosim.orchestrator.exit_status import INTERRUPTED

COLLECTED = 200_000
"""New objects between searches for garbage: what is loaded stays, and a search of it is 30 ms."""


def main() -> None:
    """Run `nrs`."""
    _take_signals()
    _keep_output()
    _print_anything()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # we have none: 10 ms
    gc.set_threshold(COLLECTED)
    atexit.register(gc.freeze)  # what ends with the process need not be searched for cycles: 50 ms
    try:
        from nrs_cosim.orchestrator.cli.main import main as run  # noqa: PLC0415

        gc.freeze()
        run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted: by the user\n")
        raise SystemExit(INTERRUPTED) from None


def _take_signals() -> None:
    """Let signals that would end the process at once interrupt it; what is ignored stays so."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, signal.default_int_handler)


def _keep_output() -> None:
    """Move our own output to a descriptor of its own, and what others print to the error's.

    The stream that was there stays open, for it would close its descriptor with it.
    """
    stream = sys.stdout
    if not isinstance(stream, TextIOWrapper) or stream is not sys.__stdout__ or not sys.stderr:
        return
    with suppress(OSError):  # no standard output, or no standard error
        own = os.dup(stream.fileno())
        os.dup2(sys.stderr.fileno(), stream.fileno())
        raw = os.fdopen(own, "wb", 0)  # nothing is left that a full disk refuses at the exit
        sys.stdout = TextIOWrapper(raw, stream.encoding, stream.errors, write_through=True)


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
