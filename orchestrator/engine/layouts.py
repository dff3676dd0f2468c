"""An algorithm of another package is tried on several layouts of workers, before anything runs.

Those that are here are not, which tests hold to one digest on all of them.
"""

from functools import partial
from typing import TYPE_CHECKING

from nrs_cosim.estimator_agents.algorithm import class_of

if TYPE_CHECKING:
    from nrs_cosim.orchestrator.scenario.experiment import Experiment


def expect_same_on_any_workers(experiment: "Experiment") -> None:
    """Raise `AlgorithmError` for what a method raises, or gives robots by who is beside them."""
    if class_of(experiment.algorithm) is type(experiment.algorithm):
        return
    from nrs_cosim.estimator_agents import layouts  # noqa: PLC0415, few need it
    from nrs_cosim.orchestrator.engine.robots import agents_of  # noqa: PLC0415, loads plants

    layouts.expect_independent_rows(
        partial(agents_of, experiment), experiment.topologies, experiment.clock, experiment.target
    )
