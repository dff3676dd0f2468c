"""The command's entry: an interrupt while the modules load is an interrupt, not a traceback."""

import sys


def main() -> None:
    """Run `nrs`."""
    try:
        from orchestrator.commands.cli import main as run  # noqa: PLC0415

        run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted: by the user\n")
        raise SystemExit(130) from None


if __name__ == "__main__":
    main()
