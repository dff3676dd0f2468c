"""A changed scenario is written beside the files that it names, and never over another file."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.orchestrator.cli.output_paths import make_folder
from nrs_cosim.orchestrator.scenario.changes import Change, with_changes
from nrs_cosim.orchestrator.scenario.comments import with_head
from nrs_cosim.orchestrator.scenario.experiment import Experiment


def changed_text(experiment: Experiment, changes: Mapping[str, Any], option: str) -> str:
    """Return a scenario's text with values by key, `algorithm.alpha`; None takes one out."""
    values = {tuple(key.split(".")): value for key, value in changes.items()}
    return with_changes(experiment.text, [Change(option, option, None, values)])


def write_scenario(output: Path, experiment: Experiment, text: str, head: Sequence[str]) -> None:
    """Write the text of a scenario that was changed, under lines that say how and for what.

    `InputError` for a file that is there, and where what the scenario names would not be found.
    """
    make_folder(output)
    if experiment.assets and output.parent.resolve() != experiment.folder.resolve():
        raise InputError(
            f"-o {output}: the scenario names files relative to {experiment.folder}; "
            "give a name in that folder"
        )
    try:
        with output.open("x", encoding="utf-8") as file:
            file.write(with_head(text, head))
    except FileExistsError:
        raise InputError(f"-o {output}: is there already; give another name") from None
    except OSError as error:
        raise InputError(f"-o {output}: cannot be written: {error.strerror}") from None
