"""What robots look like: known of the bundled models alone, from the parameters of the scenario."""

import numpy as np

from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.plant_fmu.bundled.declaration import declaration
from nrs_cosim.recordings.export.scene import Shape, write_scene

__all__ = ["shapes_of", "write_scene"]


def shapes_of(experiment: Experiment) -> dict[int, Shape]:
    """Return the shapes of those robots whose plants are bundled models, by number, from 1."""
    found = {i: _shape(plant, experiment.m) for i, plant in enumerate(experiment.plants, 1)}
    return {i: shape for i, shape in found.items() if shape is not None}


def _shape(plant: Plant, m: int) -> Shape | None:
    if plant.fmu == "planar_robot":
        return Shape()
    names = {"two_link_arm": ["r1", "r2"], "n_link_arm": ["r"]}.get(plant.fmu)
    if names is None:
        return None
    declared = declaration(plant.fmu)
    lengths: list[float] = []
    for name in names:
        given = plant.parameters.get(name, declared.variable(name).start)
        lengths += np.atleast_1d(np.array(given, float)).tolist()
    return Shape(tuple(lengths if len(lengths) == m else lengths * m))
