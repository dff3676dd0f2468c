"""Where plants are given chords of what agents estimate between sampling times, and how far off.

A line is followed by every plant; a constant acceleration by those into whose right-hand side or
torque the PD law is put here, and by FMUs with an input for it; all else is given in chords.
"""

from dataclasses import dataclass

from nrs_cosim.bus.clock import seconds
from nrs_cosim.estimator_agents.flow import acceleration_of, chord_errors, follows_lines
from nrs_cosim.orchestrator.scenario.conversion import names_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.plant_fmu.bundled.declaration import bundled_models
from nrs_cosim.plant_fmu.errors import FmuError


@dataclass(frozen=True, slots=True)
class Chords:
    """References that are given to plants as chords of what agents estimate, and so are off."""

    fmus: tuple[str, ...]
    """Of the plants that are given chords, or of which that is not known."""
    step: float
    """s: no output step is longer."""
    position: float
    """rad, at most, while an estimated acceleration is within γ2."""
    velocity: float
    """rad/s, likewise."""


def chords_of(experiment: Experiment) -> Chords | None:
    """Return what chords are given to an experiment's plants; None where there are none."""
    if follows_lines(experiment.algorithm, experiment.sizes):
        return None
    curved = acceleration_of(experiment.algorithm, experiment.sizes) is not None
    plants = {plant.model_dump_json(): plant for plant in experiment.plants}
    fmus = {p.fmu for p in plants.values() if not (curved and _takes_it(experiment, p))}
    if not fmus:
        return None
    step = seconds(experiment.clock.longest) / experiment.clock.parts
    _, gamma_2 = experiment.target.bounds()
    return Chords(tuple(sorted(fmus)), step, *chord_errors(gamma_2, step))


def _takes_it(experiment: Experiment, plant: Plant) -> bool:
    """Return whether a plant is known to follow an acceleration."""
    if plant.fmu in bundled_models():
        return True
    from nrs_cosim.orchestrator.engine.plants import find_in  # noqa: PLC0415, it opens FMUs
    from nrs_cosim.plant_fmu.archives.presence import takes  # noqa: PLC0415, as above
    from nrs_cosim.plant_fmu.drives.choice import Driving, choose  # noqa: PLC0415, as above
    from nrs_cosim.plant_fmu.drives.reference_driven import (  # noqa: PLC0415, as above
        ACCELERATION,
    )

    names = names_of(plant.variables)
    try:
        archive = find_in(experiment)(plant.fmu)
        way = choose(archive, names, Driving.of(plant)).way
        return way != "reference" or takes(archive, names, ACCELERATION)
    except FmuError:
        return False
