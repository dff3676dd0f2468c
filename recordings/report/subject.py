"""What a report must know of a run and its messages do not tell: it follows from the scenario."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.recordings.measurement import TargetAt
from nrs_cosim.recordings.units import rate_of, unit_over

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class GainMap:
    """ρ over both gains of an algorithm."""

    names: tuple[str, str]
    """Of x and y."""
    values: tuple[Array, Array]
    """(x,) and (y,), evenly from 0 on, in the middle of cells."""
    radius: Array
    """(y, x); not a number where it is not known."""
    own: tuple[float, float]
    """Those of the run."""


@dataclass(frozen=True, slots=True, eq=False)
class Subject:
    """The scenario's side of a run."""

    estimator: str
    """Its algorithm and gains, in words."""
    times: Clock
    pace: str
    """How often samples are exchanged, in words."""
    target_at: TargetAt
    topologies: TopologySchedule
    phases: str
    """When these links are there, in words; empty where it is always."""
    units: Sequence[str]
    """(m,) of each joint's position over all robots, see `unit_over`."""
    joints: Sequence[str]
    """(m,) what all robots call their joints, or their numbers in words."""
    conditions: Sequence[Mapping[str, Any]]
    """Of the theory, each with `name`, `value`, `bound` (None that no number reaches), `at_least`
    (whether it is value > bound, not <), `status` as `nrs check` has it, and `source`."""
    spectral_radius: float | None
    """ρ: what is left of the estimation error after one sampling period, in steady state.

    None where there is no such number, or links have faults or robots lie, of which it knows
    nothing.
    """
    byzantine: Sequence[int]
    """The robots that lie, whose errors are not measured."""
    bounds: Mapping[str, Mapping[str, float]]
    """Of the fields of `SteadyState`: each bound that the theory has for it, by its name."""
    settings: Mapping[str, str]
    """The scenario's keys with their values, in words."""
    plants: Sequence[Mapping[str, str]] = ()
    """A row for robots of one FMU, the same parameters and controller, by the columns' names."""
    gains: GainMap | None = None
    """None where it is not made."""
    links: str = ""
    """What they did to samples, and which robots were silent, in words; empty if they are sound."""
    torque_limits: Mapping[int, Array] = field(default_factory=dict)
    """(m,) of each robot that has any."""

    no_theory: str = ""
    """Why nothing of theory is drawn, where nothing is known."""

    @property
    def topology(self) -> Topology:
        """All links that there are at some time, each with its largest weight."""
        return self.topologies.links

    @property
    def unit(self) -> str:
        """That of all joints' positions; see `unit_over`."""
        return unit_over(self.units)

    @property
    def rate(self) -> str:
        """The unit of all joints' velocities."""
        return rate_of(self.unit)
