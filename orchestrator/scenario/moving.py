"""A target that is an FMU is run once, when its scenario's file is read; the text then says it all.

It is sampled at every time of which a run asks, so that there the target is exactly where the FMU
was, and in between often enough that the cubics of Hermite are near to what was not looked at. Its
samples stand in the text, whence workers, replays and resumed runs have them without the FMU.
"""

import tomllib
from collections.abc import Sequence
from pathlib import Path
from secrets import token_hex
from typing import Any

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import CosimError
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.conversion import names_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.inlining import Array, written
from nrs_cosim.orchestrator.scenario.smoothness import expect_smooth
from nrs_cosim.orchestrator.scenario.tables.scenario import Scenario
from nrs_cosim.orchestrator.scenario.tables.targets import FmuTarget
from nrs_cosim.orchestrator.scenario.targets import wrong_variables
from nrs_cosim.orchestrator.scenario.times import wrong_times
from nrs_cosim.plant_fmu.drives.grid import parts
from nrs_cosim.plant_fmu.errors import FmuError

PARTS = 4
"""Of a sampling period, at least, unless the scenario says otherwise."""
MOST = 1_000_000
"""Samples."""


def with_motion(text: str, folder: Path, origin: str) -> str:
    """Return a scenario's text with the samples of its target's FMU, if it has one without them.

    Any other text is returned as it is, with all that may be wrong in it. Errors begin with
    `origin`.
    """
    if '"fmu"' not in text and "'fmu'" not in text:
        return text
    try:
        scenario = Scenario.model_validate(tomllib.loads(text))
        experiment = Experiment(scenario, text, origin, folder)
        clock = experiment.clock
    except (ValueError, ArithmeticError, RecursionError):
        return text
    target = scenario.target
    if not isinstance(target, FmuTarget) or target.times or target.positions:
        return text
    if any(wrong_variables(target)) or any(wrong_times(experiment)):
        return text
    times = _grid(clock, target.step)
    if len(times) > MOST:
        raise ScenarioError(
            f"{origin}: target.step: expected up to {MOST} samples of the FMU, got "
            f"{target.step or 'a quarter of the sampling period'}; give a longer step"
        )
    import tomlkit  # noqa: PLC0415, as in `inlining`

    from nrs_cosim.plant_fmu.archives.archive import find_archive  # noqa: PLC0415, it loads FMPy
    from nrs_cosim.plant_fmu.motion import fmu_motion  # noqa: PLC0415, as above

    names = names_of(target.variables)
    try:
        archive = find_archive(target.fmu, folder)
        if clock.period is None and not archive.takes_uneven_steps:
            raise FmuError(
                f"{archive.label}: lacks canHandleVariableCommunicationStepSize, and sampling "
                f"times are aperiodic"
            )
        deadline = target.deadline if target.isolate and not archive.ours else None

        def sample(at: Sequence[float]) -> tuple[Array, Array]:
            return fmu_motion(archive, target.parameters, names, at, deadline)

        moved = sample(times)
        again = sample if archive.takes_uneven_steps else None
        expect_smooth(archive.label, times, *moved, again)
    except CosimError as error:
        raise ScenarioError(f"{origin}: target.fmu: {error}") from None
    document = tomlkit.parse(text)
    table: Any = document["target"]
    table["sha256"] = archive.sha256
    samples = {"times": times, "positions": moved[0].tolist(), "velocities": moved[1].tolist()}
    # Likewise as edges are in `graphs`: a word that no text has, and in its place the rows.
    holes = {name: token_hex(16) for name in samples}
    for name, hole in holes.items():
        table[name] = hole
    whole = tomlkit.dumps(document)
    for name, hole in holes.items():
        whole = whole.replace(f'"{hole}"', written(samples[name]), 1)
    return whole


def _grid(clock: Clock, step: float | None) -> list[float]:
    """Return all output times, s, and equally far apart between them others, up to too many."""
    times = [0.0]
    for k in range(1, clock.ticks + 1):
        outputs = clock.outputs(k)
        for ns in outputs:
            start, end = times[-1], seconds(ns)
            count = parts(end - start, step) if step else -(-PARTS // len(outputs))
            times += [start + j * (end - start) / count for j in range(1, min(count, MOST))]
            times.append(end)
        if len(times) > MOST:
            break
    return times
