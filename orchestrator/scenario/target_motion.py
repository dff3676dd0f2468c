"""A target that is an FMU is run once, when its scenario is resolved; its samples are an asset.

It is sampled at every time of which a run asks, so that there the target is exactly where the FMU
was, and in between often enough that the cubics of Hermite are near to what was not looked at.
Workers, replays and resumed runs have the samples, and need no FMU.
"""

from collections.abc import Sequence

import numpy as np

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import CosimError
from nrs_cosim.orchestrator.errors import ScenarioError
from nrs_cosim.orchestrator.scenario.assets import TABLE, Asset
from nrs_cosim.orchestrator.scenario.conversion import names_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.resolution import TARGET_FMU, moved
from nrs_cosim.orchestrator.scenario.samples import Array, Samples
from nrs_cosim.orchestrator.scenario.smoothness import expect_smooth
from nrs_cosim.orchestrator.scenario.tables.targets import FmuTarget
from nrs_cosim.orchestrator.scenario.targets import wrong_variables
from nrs_cosim.orchestrator.scenario.times import wrong_times
from nrs_cosim.plant_fmu.drives.grid import parts
from nrs_cosim.plant_fmu.errors import FmuError

PARTS = 4
"""Of a sampling period, at least, unless the scenario says otherwise."""
MOST = 1_000_000
"""Samples."""


def with_motion(experiment: Experiment, target: FmuTarget, origin: str) -> Experiment:
    """Return an experiment with the samples of its target's FMU; errors begin with its origin."""
    faults = [*wrong_variables(target), *wrong_times(experiment)]
    if faults:
        raise ScenarioError("\n".join(f"{origin}: {fault}" for fault in faults))
    times = _grid(experiment.clock, target.step)
    if len(times) > MOST:
        raise ScenarioError(
            f"{origin}: target.step: expected up to {MOST} samples of the FMU, got "
            f"{target.step or 'a quarter of the sampling period'}; give a longer step"
        )
    try:
        asset = _run(experiment, target, times)
    except CosimError as error:
        raise ScenarioError(f"{origin}: {TARGET_FMU}: {error}") from None
    scenario = experiment.scenario.model_copy(update={"target": moved(target, asset)})
    return experiment.but(scenario=scenario, assets={**experiment.assets, TARGET_FMU: asset})


def _run(experiment: Experiment, target: FmuTarget, times: Sequence[float]) -> Asset:
    """Return what an FMU does as an asset."""
    from nrs_cosim.plant_fmu.archives.archive import find_archive  # noqa: PLC0415, it opens FMUs
    from nrs_cosim.plant_fmu.motion import fmu_motion  # noqa: PLC0415, as above

    names = names_of(target.variables)
    archive = find_archive(target.fmu, experiment.folder)
    if experiment.clock.period is None and not archive.takes_uneven_steps:
        raise FmuError(
            f"{archive.label}: lacks canHandleVariableCommunicationStepSize, and sampling times "
            f"are aperiodic"
        )
    deadline = target.deadline if target.isolate and not archive.ours else None

    def sample(at: Sequence[float]) -> tuple[Array, Array]:
        return fmu_motion(archive, target.parameters, names, at, deadline)

    positions, velocities = sample(times)
    again = sample if archive.takes_uneven_steps else None
    expect_smooth(archive.label, times, positions, velocities, again)
    table = Samples(np.array(times), positions, velocities).written()
    return Asset.of(target.fmu, archive.sha256, TABLE, table)


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
