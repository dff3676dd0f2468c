"""P3 of FMUs that are not bundled is sampled, once for each, where their files are at hand."""

from nrs_cosim.bus.errors import CosimError
from nrs_cosim.orchestrator.engine.plants import find_in
from nrs_cosim.orchestrator.scenario.conversion import names_of
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.fmus import Plant
from nrs_cosim.plant_fmu.bundled.bounds import Bounds
from nrs_cosim.plant_fmu.drives.choice import Driving

MOST = 4
"""Different plants that are sampled, of a scenario with many."""


class Sampling:
    """What is found of a scenario's plants; see `orchestrator.analysis.plant_bounds.Find`."""

    def __init__(self, experiment: Experiment) -> None:
        self._experiment, self._found = experiment, dict[str, Bounds | str]()

    def __call__(self, plant: Plant, robot: int) -> Bounds | str:
        """Return P3 of a robot's plant, or why there is none."""
        key = plant.model_dump_json()
        if key not in self._found:
            more = len(self._found) < MOST
            self._found[key] = (
                self._sampled(plant, robot) if more else f"no more than {MOST} plants are sampled"
            )
        return self._found[key]

    def _sampled(self, plant: Plant, robot: int) -> Bounds | str:
        from nrs_cosim.plant_fmu.checking.findings import CheckTask  # noqa: PLC0415, of these alone
        from nrs_cosim.plant_fmu.checking.subprocess_check import p3_of  # noqa: PLC0415, as above

        (body,) = self._experiment.bodies([robot])
        try:
            archive = find_in(self._experiment)(plant.fmu)
            return p3_of(CheckTask(archive, body, names_of(plant.variables), Driving.of(plant)))
        except CosimError as error:
            return f"the bounds of P3 cannot be sampled: {error}"
