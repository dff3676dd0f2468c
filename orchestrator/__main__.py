"""The command's entry: an interrupt while the modules load is an interrupt, not a traceback.

Linear algebra has one thread unless the user says otherwise: where the processors have other work,
as those of a run's hosts have, more of them wait for one another by spinning.
"""

import os
import sys


def main() -> None:
    """Run `nrs`."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from orchestrator.commands.cli import main as run  # noqa: PLC0415

        run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted: by the user\n")
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
