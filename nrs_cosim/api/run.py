"""A run from a script or a notebook: a scenario in, a recording out, and nothing printed."""

import logging
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from types import FrameType
from typing import Literal

from nrs_cosim.api.recording import Recording
from nrs_cosim.api.scenario import Scenario
from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted
from nrs_cosim.orchestrator.cli.output_paths import Place, place_for
from nrs_cosim.orchestrator.cli.terminal_run import resumable
from nrs_cosim.orchestrator.cluster.launcher import local_workers, workers_worth_it
from nrs_cosim.orchestrator.cluster.policy import WorkerPolicy
from nrs_cosim.orchestrator.engine.in_process import in_process
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
) -> Recording:
    """Run a scenario into a recording, and return it, opened for reading.

    It works in a script without a main guard, in a thread, in a loop of asyncio, which it blocks,
    and in a notebook. An interrupt (Ctrl-C) closes the recording before it is raised again.

    Args:
        scenario: What is run.
        output: Where the recording goes; by default into a temporary file, which is there as long
            as the recording is open.
        workers: How many processes share the robots; 1 is this one, `auto` decides by processors
            and robots. The recording's messages are the same whatever their number.
        progress: Is called with the simulated time that is reached, and the run's duration, s.
        deadline: After so many s without a message the run fails, and says who is silent; by
            default the scenario's.
        force: Replace a recording that is there, once the new one is complete.

    Returns:
        The recording. Its `status` says how the run ended: one that failed, because its estimates
        diverge or a plant cannot be stepped, is recorded up to there, with the reason.

    Raises:
        InputError: The scenario's plants cannot be found or opened, or the output is there already
            or cannot be written.
        RunError: The run failed before its robots had a state, so that nothing is recorded.

    Example:
        >>> import nrs_cosim as nrs
        >>> scenario = nrs.Scenario.load("scenarios/paper_first_order.toml")
        >>> with nrs.run(scenario.replace({"run.duration": 1.0})) as recording:
        ...     recording.status, recording.ticks
        ('completed', 10)
    """
    experiment = scenario._experiment
    return execute(
        experiment, output, _launcher(experiment, workers), progress, deadline, force, None
    )


def resume(
    recording: str | PathLike[str] | Recording,
    output: str | PathLike[str] | None = None,
    *,
    workers: int | Literal["auto"] = 1,
    progress: Progress | None = None,
    deadline: float | None = None,
    force: bool = False,
) -> Recording:
    """Continue a run that did not come to its end, in a new recording that holds all of it.

    Args:
        recording: The one that ends too early, or its path.
        output: Where the new one goes; see `run`, as for the rest.

    Raises:
        InputError: There is nothing to resume, or an FMU is not the one that was recorded.
        RunError: See `run`.
    """
    with ExitStack() as stack:
        begun = recording
        if not isinstance(begun, Recording):
            begun = stack.enter_context(Recording(begun))
        experiment = resumable(begun._reader, None if output is None else Path(output))
        past = past_of(begun._reader)
        launcher = _launcher(experiment, workers)
        return execute(experiment, output, launcher, progress, deadline, force, past)


def _launcher(experiment: Experiment, workers: int | Literal["auto"]) -> Launcher:
    n = experiment.n
    count = workers_worth_it(n) if workers == "auto" else workers
    if not (isinstance(count, int) and 1 <= count <= n):
        raise InputError(
            f"workers: expected auto or 1 to {n}, a robot each at least, got {quoted(workers)}"
        )
    return (
        in_process(experiment)
        if count == 1
        else local_workers(experiment, count, WorkerPolicy(True, WAIT, _LOG.info))
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
        stopped = stack.enter_context(_interrupts())

        def watch(time_ns: int) -> None:
            if progress:
                progress(seconds(time_ns), end)
            if stopped():
                raise Interrupted

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
        if stopped():
            raise KeyboardInterrupt
        if output is None:
            undo.pop_all()
            return Recording._temporary(path, folder)
    return Recording(path)


@contextmanager
def _interrupts() -> Iterator[Callable[[], bool]]:
    """Turn the first Ctrl-C into a question with the answer yes; the second ends all at once.

    Where interrupts go is decided in the main thread alone; in another one they do not arrive.
    """
    came = False
    if threading.current_thread() is not threading.main_thread():
        yield lambda: False
        return

    def stop(_number: int, _frame: FrameType | None) -> None:
        nonlocal came
        if came:
            raise KeyboardInterrupt
        came = True

    before = signal.signal(signal.SIGINT, stop)
    try:
        yield lambda: came
    finally:
        signal.signal(signal.SIGINT, before)
