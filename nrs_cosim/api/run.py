"""A run from a script or a notebook: a scenario in, a recording out, and nothing printed."""

import logging
import signal
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from numbers import Integral
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

from nrs_cosim.api.recording import Recording
from nrs_cosim.api.scenario import Scenario, change_of, experiment_of
from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.output_paths import Place, place_for, unfinished
from nrs_cosim.orchestrator.cli.terminal_run import resumable
from nrs_cosim.orchestrator.cluster.launcher import local_workers, workers_worth_it
from nrs_cosim.orchestrator.cluster.supervision import WorkerPolicy
from nrs_cosim.orchestrator.engine.attachments import with_fmus
from nrs_cosim.orchestrator.engine.in_process import in_process, threads_worth_it
from nrs_cosim.orchestrator.engine.interrupts import interrupts
from nrs_cosim.orchestrator.engine.lockstep import Launcher
from nrs_cosim.orchestrator.engine.run import past_of
from nrs_cosim.orchestrator.engine.run import run as run_experiment
from nrs_cosim.orchestrator.errors import Interrupted
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.recordings.mcap.container import Message

Progress = Callable[[float, float], None]
"""Is called with the simulated time that is reached, and the run's duration, s."""

WAIT = 60.0
_LOG = logging.getLogger("nrs_cosim.run")


def run(
    scenario: Scenario,
    output: str | PathLike[str] | None = None,
    *,
    workers: int | Literal["auto"] = 1,
    progress: Progress | None = None,
    deadline: float | None = None,
    force: bool = False,
    embed_fmus: bool = False,
) -> Recording:
    """Run a scenario into a recording, and return it, opened for reading.

    It works in a script without a main guard, in a thread, in a loop of asyncio, which it blocks,
    and in a notebook. Ctrl-C ends it at the next output time: the recording is closed, with the
    status `interrupted`, and then `KeyboardInterrupt` is raised. In a thread no signal arrives:
    there `progress` ends the run by raising what it likes.

    Args:
        scenario: What is run.
        output: Where the recording goes; by default into a temporary file, which is there as long
            as the recording is open.
        workers: How many processes share the robots; 1 is this one, `auto` decides by processors
            and robots. The recording's messages are the same whatever their number.
        progress: Is called with the simulated time that is reached, and the run's duration, s, in
            the thread of the run. What it raises interrupts the run, as Ctrl-C does, and is raised
            again once the recording is closed.
        deadline: After so many s without a message the run fails, and says who is silent; by
            default the scenario's.
        force: Replace a recording that is there, once the new one is complete.
        embed_fmus: Record the plants' FMUs too, so that the run can be repeated where their files
            are not.

    Returns:
        The recording. Its `status` says how the run ended: one that failed, because its estimates
        diverge or a plant cannot be stepped, is recorded up to there, with the reason.

    Raises:
        InputError: The scenario's plants cannot be found or opened, or the output is there already
            or cannot be written.
        RunError: The run failed before its robots had a state, so that nothing is recorded.
        KeyboardInterrupt: The user stopped the run by Ctrl-C; the recording is at `output`.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
        ...     recording.status, recording.ticks
        ('completed', 10)
    """
    experiment = experiment_of(scenario)
    if embed_fmus:
        experiment = with_fmus(experiment)
    return execute(
        experiment, output, _launcher(experiment, workers), progress, deadline, force, None
    )


def resume(
    recording: str | PathLike[str] | Recording,
    output: str | PathLike[str] | None = None,
    *,
    changes: Mapping[str, Any] | None = None,
    workers: int | Literal["auto"] = 1,
    progress: Progress | None = None,
    deadline: float | None = None,
    force: bool = False,
    allow_fmus: bool = False,
) -> Recording:
    """Continue a run that did not come to its end, in a new recording that holds all of it.

    Args:
        recording: The one that ends too early, or its path. Where a run was to replace the
            recording at that path and did not come to its end, that run is continued.
        output: Where the new one goes; see `run`, as for the rest.
        changes: Values by key, as in `Scenario.replace`, of what decides nothing that is recorded:
            `run.duration`, which may continue a completed run, `run.divergence_limit`,
            `run.checkpoint_every`, `bus.deadline` and `plant.deadline`.
        allow_fmus: Run the FMUs that the recording holds, which are native code.

    Returns:
        The recording of the whole run, the ticks of the earlier one being copied.

    Raises:
        InputError: There is nothing to resume, an FMU is not the one that was recorded, or a change
            is of another key.
        RunError, KeyboardInterrupt: See `run`.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as short:
        ...     with nrs.resume(short, changes={"run.duration": 2.0}) as longer:
        ...         longer.status, short.ticks, longer.ticks
        ('completed', 10, 20)
    """
    with ExitStack() as stack:
        if isinstance(recording, Recording):
            begun = recording
        else:
            begun = stack.enter_context(Recording(unfinished(Path(recording))))
        new, asked = None if output is None else Path(output), change_of(changes or {})
        experiment = resumable(
            begun._reader, new, [asked] if changes else [], allow_fmus=allow_fmus
        )
        past = past_of(begun._reader)
        launcher = _launcher(experiment, workers)
        return execute(experiment, output, launcher, progress, deadline, force, past)


def _launcher(experiment: Experiment, workers: int | Literal["auto"]) -> Launcher:
    n = experiment.n
    count = workers_worth_it(n) if workers == "auto" else workers
    if not (isinstance(count, Integral) and 1 <= count <= n):
        raise InputError(
            f"workers: expected auto or 1 to {n}, a robot each at least, got {quoted(workers)}"
        )
    return (
        in_process(experiment, threads_worth_it(n))
        if count == 1
        else local_workers(
            experiment,
            int(count),
            WorkerPolicy(True, WAIT, _LOG.info),
            threads_worth_it(n, int(count)),
        )
    )


def execute(
    experiment: Experiment,
    output: str | PathLike[str] | None,
    launcher: Launcher,
    progress: Progress | None,
    deadline: float | None = None,
    force: bool = False,
    past: Iterator[list[Message]] | None = None,
    metadata: Mapping[str, Mapping[str, str]] | None = None,
) -> Recording:
    """Run an experiment, and return its recording."""
    if deadline is not None and not deadline > 0:
        raise InputError(f"deadline: expected more than 0 s, got {deadline:g}")
    clock = experiment.clock
    end = seconds(clock.t(clock.ticks))
    with ExitStack() as stack:
        if output is None:
            folder = TemporaryDirectory(prefix="nrs-run-")
            undo = stack.enter_context(ExitStack())
            undo.callback(folder.cleanup)
            path = Path(folder.name) / f"{experiment.name}.mcap"
            place = Place(path, path)
        else:
            place = stack.enter_context(place_for(Path(output), experiment.name, force=force))
        ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
        interrupted = stack.enter_context(interrupts([] if ignored else [signal.SIGINT]))
        raised: BaseException | None = None

        def watch(time_ns: int) -> None:
            nonlocal raised
            if interrupted():
                raise Interrupted
            try:
                if progress:
                    progress(seconds(time_ns), end)
            except BaseException as error:  # the caller's, once the recording is closed
                raised = error
                raise Interrupted from error

        outcome = run_experiment(
            experiment,
            place.written.absolute(),
            launcher,
            watch=watch,
            deadline=deadline,
            past=past,
            metadata=metadata,
        )
        path = place.settle(outcome.status == "completed")
        if raised:
            raise raised
        if interrupted():
            raise KeyboardInterrupt
        if output is None:
            undo.pop_all()
            return Recording._temporary(path, folder)
    return Recording(path)
