"""An algorithm whose rows depend on one another is refused; one whose rows do not is let pass."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from nrs_cosim import Algorithm
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.event_triggered import EventTriggered
from nrs_cosim.estimator_agents.kalman_consensus import KalmanConsensus
from nrs_cosim.estimator_agents.layouts import expect_independent_rows
from nrs_cosim.estimator_agents.wmsr import Wmsr
from tests.estimator_agents.agents_without_bus import CLOCK, agents_at
from tests.estimator_agents.paper import HARMONIC

ALL = np.array([[0, 1, 0, 0], [1, 0, 1, 0], [0, 1, 0, 1], [1, 0, 1, 0]])
PINNED = np.array([1, 0, 1, 1])
Change = Callable[[Any], Any]


@dataclass(frozen=True)
class Changed(Algorithm):
    """Each method changes positions as it is told to, in itself not at all."""

    TRIGGERED: ClassVar = True
    method: str = ""
    change: Change = lambda rows: rows

    def _position(self, method, x):
        rows = self.change(x.position) if method == self.method else x.position
        return x.replace(position=rows)

    def flow(self, x, dt):
        return self._position("flow", super().flow(x, dt))

    def measure(self, now, target):
        rows = target.position + now.normal("look", 2)
        return self._position("measure", target.replace(position=rows))

    def observe(self, now, x, measured, pinned):  # noqa: ARG002
        looked = np.where(pinned[:, None], measured.position, x.position)
        return self._position("observe", x.replace(position=looked))

    def send(self, now, x):
        left, messages, _ = super().send(now, x)
        sends = self._position("decision", x).position[:, 0] <= x.position[:, 0]
        return left, self._position("send", messages), sends

    def receive(self, now, x, received):  # noqa: ARG002
        pull = received.disagreement("position", x.position)
        return self._position("receive", x.replace(position=x.position + 0.5 * pull))


def tried(algorithm):
    topologies = TopologySchedule.constant(Topology.of(ALL, PINNED))

    def agents_of(robots):
        start = Estimate(*np.zeros((2, len(robots), 2)))
        return agents_at(robots, topologies, algorithm, start)

    expect_independent_rows(agents_of, topologies, CLOCK, HARMONIC)


MIXING = {
    "mean": lambda rows: rows - 0.1 * rows.mean(axis=0),
    "first": lambda rows: rows[:1] + 0 * rows,
    "order": lambda rows: np.sort(rows, axis=0),
    "count": lambda rows: rows + len(rows) - 2.5,
}


@pytest.mark.parametrize("mixing", MIXING)
@pytest.mark.parametrize("method", ["flow", "measure", "observe", "send", "receive", "decision"])
def test_rows_that_depend_on_one_another_are_refused_by_method(method, mixing):
    where = "send" if method == "decision" else method
    what = "decision" if method == "decision" else "position"
    expected = (
        f"algorithm Changed: {where} returned another {what} for robot .*own row and in-edges"
    )
    with pytest.raises(AlgorithmError, match=expected):
        tried(Changed(method, MIXING[mixing]))


def test_last_digits_that_depend_on_the_number_of_rows_are_refused_as_such():
    rounded = Changed("receive", lambda rows: rows if len(rows) > 1 else np.nextafter(rows, 9))
    with pytest.raises(AlgorithmError, match=r"robot 1 alone .*only last digits differ"):
        tried(rounded)


def test_what_is_not_the_same_when_asked_again_is_refused_as_such():
    drawn = Changed("send", lambda rows: rows + np.random.default_rng().random(rows.shape))
    with pytest.raises(AlgorithmError, match="when asked once more at tick 1; draw from now"):
        tried(drawn)


def test_what_fails_for_few_robots_alone_is_refused_with_how_many():
    with pytest.raises(
        AlgorithmError, match=r"position of nan for robot 1 at .*, for robots alone"
    ):
        tried(Changed("receive", lambda rows: rows if len(rows) > 1 else rows + np.nan))


def test_no_numbers_of_all_robots_are_for_the_run_to_tell():
    tried(Changed("receive", lambda rows: rows + np.inf))


@pytest.mark.parametrize(
    "algorithm",
    [
        Changed(),
        FirstOrder(0.9, 1.1),
        EventTriggered(0.9, 1.1, 0.1, 0.1),
        KalmanConsensus(1.0, 1.0),
        Wmsr(1),
    ],
    ids=lambda algorithm: type(algorithm).__name__,
)
def test_rows_of_their_own_are_let_pass(algorithm):
    tried(algorithm)
