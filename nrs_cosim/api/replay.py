"""A recording run again: is it the same to the last bit, and what if something had been another?"""

from collections.abc import Collection, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from nrs_cosim.api.recording import Recording
from nrs_cosim.api.run import Progress, execute
from nrs_cosim.api.scenario import change_of
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.analysis.results import wrong_at_end
from nrs_cosim.orchestrator.cli.output_paths import expect_another
from nrs_cosim.orchestrator.engine.attachments import with_allowed_fmus
from nrs_cosim.orchestrator.engine.in_process import in_process
from nrs_cosim.orchestrator.replay import diff
from nrs_cosim.orchestrator.replay import verify as verify_module
from nrs_cosim.orchestrator.replay.diff import Comparison
from nrs_cosim.orchestrator.replay.verify import Verification
from nrs_cosim.orchestrator.replay.what_if import changed_run

__all__ = ["Comparison", "Verification", "compare", "verify", "what_if"]

Source = str | PathLike[str] | Recording


def verify(
    recording: Source, *, agents_only: bool = False, allow_fmus: bool = False
) -> Verification:
    """Run a recording again, and hold every message against the recorded one, bit by bit.

    Args:
        recording: The recording, or its path.
        agents_only: Run no plant: what the robots did is taken as recorded. No native code of
            others is run then.
        allow_fmus: Run the FMUs that the recording holds, which are native code.

    Returns:
        How many messages are the same, the first that is not, and how many could not be looked
        at; its `status` is `identical`, `differs` or `unverified`.

    Raises:
        InputError: It is no recording of a run, or an FMU is not the one that was recorded.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
        ...     nrs.replay.verify(recording, agents_only=True).status
        'identical'
    """
    with _opened(recording) as opened:
        experiment = opened._experiment
        if allow_fmus:
            experiment = with_allowed_fmus(experiment)
        found = verify_module.verify(opened._reader, experiment, plants=not agents_only)
        if found.status == "identical" and not found.by_libraries:
            found = replace(found, at_end=wrong_at_end(opened._reader, experiment))
        return found


def what_if(
    recording: Source,
    changes: Mapping[str, Any],
    output: str | PathLike[str] | None = None,
    *,
    robots: Collection[int] | None = None,
    progress: Progress | None = None,
    force: bool = False,
    allow_fmus: bool = False,
) -> Recording:
    """Return what a run would have been with other plants, another controller or other gains.

    Estimates do not depend on plants: where keys of `plant`, `controller` and `disturbance` alone
    are changed, the robots whose they are run again, and all others do what they did. Where keys of
    `algorithm` are changed, all run again.

    Args:
        recording: A completed recording, or its path.
        changes: Values by key, as in `Scenario.replace`.
        output: Where the new recording goes; see `run`, as for the rest.
        robots: Whose plants are changed; all unless given.
        allow_fmus: Run the FMUs that the recording holds, which are native code.

    Raises:
        InputError: A key or value is wrong, or the recording is not complete.
        RunError: See `run`.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
        ...     with nrs.replay.what_if(recording, {"controller.kp": 150.0}, robots=[3]) as stiff:
        ...         found = nrs.compare(recording, stiff)
        ...         found.first.robot, found.is_same
        (3, False)
    """
    if not changes:
        raise InputError("changes: expected a key and a value at least, got none")
    prefix = "algorithm."
    plants = {key: value for key, value in changes.items() if not key.startswith(prefix)}
    algorithms = {key.removeprefix(prefix): changes[key] for key in changes if key not in plants}
    if robots is not None and (algorithms or not robots):
        raise InputError(
            f"robots: expected some, and changes of their plants alone, got {quoted([*robots])}"
        )
    with _opened(recording) as opened:
        if output is not None:
            expect_another(Path(output), opened.path)
        experiment, launcher, metadata = changed_run(
            opened._reader,
            [change_of(plants, robots)] if plants else [],
            [change_of(algorithms)] if algorithms else [],
            allow_fmus=allow_fmus,
        )
        return execute(
            experiment,
            output,
            launcher or in_process(experiment),
            progress,
            force=force,
            metadata=metadata,
        )


def compare(a: Source, b: Source) -> Comparison:
    """Say what is not the same in two recordings: scenario, first message, distances of states.

    Args:
        a: A recording, or its path.
        b: Another.

    Returns:
        The comparison: `is_same`, the scenario's `fields` that differ, the `first` message that
        does, and the `distances` of the robots' states; `as_json()` is what `nrs diff --json` says.
        Whole recordings of the same digest are the same, and no message is `compared`.

    Raises:
        InputError: One of them is no recording of a run, or holds no tick.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> short = scenario.replace({"run.duration": 1.0})
        >>> with nrs.run(short) as one, nrs.run(short.replace({"run.seed": 2})) as other:
        ...     nrs.compare(one, other).fields
        {'run.seed': (1, 2)}
    """
    with _opened(a) as one, _opened(b) as other:
        return diff.compare(one._reader, other._reader)


@contextmanager
def _opened(recording: Source) -> Iterator[Recording]:
    """Give a recording that is open; one that was given open stays so."""
    with ExitStack() as stack:
        if not isinstance(recording, Recording):
            recording = stack.enter_context(Recording(recording))
        yield recording
