"""What a robot's agent comes to does not depend on which others its worker has: it is tried.

An algorithm is given arrays with a row a robot, of those robots alone that a worker has. One whose
rows depend on one another is another algorithm on every layout of workers, and what is read off its
code is of none of them. So the first sampling times are gone through by all robots at once, and
beside them by two groups and by some robots alone, who receive the same samples: all come to the
same, to the last bit. What a method raises there, it raises.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.random_streams import keyed_uniform
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.algorithm import class_of, overrides
from nrs_cosim.estimator_agents.errors import AlgorithmError
from nrs_cosim.estimator_agents.returned import wrong_return
from nrs_cosim.estimator_agents.target import Target, sample_of
from nrs_cosim.estimator_agents.values import Array, Values

TICKS = 3
"""Sampling times that are gone through."""
MOST = 256
"""Of all robots those that are tried, the first; of others they have what is there before t_1."""
ALONE = 6
"""Robots, the first and the first that are pinned, that are tried alone."""
APART = 1e-3
"""By how much initial estimates are moved at most: no two robots' are the same then."""
ROUNDING = 1e-9
"""Relative: what differs by less does so by the order in which it was added up."""

MIXED = "take a row from that robot's own row and in-edges alone, as received.mean does"
ROUNDED = "only last digits differ, as of matrix products by the number of rows: write them out"

Outcome = tuple[str, NDArray[np.integer], Mapping[str, Array]]
"""A method, the robots of the rows that it returned, and these by name."""


@dataclass(slots=True)
class _Group:
    """Some robots that go through the sampling times together."""

    agents: Agents
    beside: str
    """How an error says which they are; nothing of all robots."""
    left: Values = field(default_factory=Values)
    messages: Values = field(default_factory=Values)
    sends: NDArray[np.bool_] | slice = field(default_factory=lambda: slice(None))

    def send(self, k: int, dt: float, target: Mapping[str, Array]) -> Iterator[Outcome]:
        """Go to t_k, dt s after the last sampling time, look at the target and send."""
        agents, robots = self.agents, self.agents.robots
        left = agents.left(dt)
        yield "flow", robots, left
        agents.receive(k, np.array([0]), target)
        if overrides(class_of(agents.algorithm), "measure"):
            pinned, measured = agents.measured(k)
            yield "measure", robots[pinned], measured
        if agents.observes:
            left = agents.observe(k, left)
            yield "observe", robots, left
        self.left, self.messages, who = agents.send(k, left)
        self.sends = slice(None) if who is None else who
        yield "send", robots, self.left
        decided = {} if who is None else {"decision": who.astype(float)}
        yield "send", robots, {**self.messages, **decided}

    def receive(self, k: int, nodes: NDArray[np.integer], messages: Values) -> Iterator[Outcome]:
        """Receive the samples of t_k."""
        self.agents.receive(k, nodes, messages)
        self.agents.jump(k, self.left)
        yield "receive", self.agents.robots, self.agents.state


def expect_independent_rows(
    agents_of: Callable[[Sequence[int]], Agents],
    topologies: TopologySchedule,
    clock: Clock,
    target: Target,
) -> None:
    """Raise `AlgorithmError` where what robots come to depends on who is beside them.

    `agents_of` returns the agents of some robots at t_0. Where an estimate of all robots is no
    number there is nothing to compare: the run says so.
    """
    every = range(1, min(topologies.n, MOST) + 1)
    whole, groups = _group(agents_of, every, ""), [_group(agents_of, every, "")]
    if len(every) > 1:
        pinned = [robot for robot in topologies.ever_pinned.tolist() if robot in every]
        alone = {*every[:ALONE], *pinned[:ALONE]}
        groups += [_group(agents_of, every[i::2], "with half of the robots") for i in (0, 1)]
        groups += [_group(agents_of, [robot], "alone") for robot in sorted(alone)]
    for k in range(1, min(TICKS, clock.ticks) + 1):
        t, before = seconds(clock.t(k)), seconds(clock.t(k - 1))
        fields = whole.agents.algorithm.SENT
        sample = {
            name: np.asarray(value)[None] for name, value in sample_of(target, fields, t).items()
        }
        try:
            expected = [*whole.send(k, t - before, sample)]
            who = whole.agents.robots[whole.sends], whole.messages.at(whole.sends)
            expected += whole.receive(k, *who)
        except AlgorithmError as error:
            if error.cause.tick is None:
                raise
            return
        for group in groups:
            try:
                found = [*group.send(k, t - before, sample), *group.receive(k, *who)]
            except AlgorithmError as error:
                where = f", for robots {group.beside} on a worker" if group.beside else ""
                raise AlgorithmError(f"{error}{where}", error.cause) from error
            for one, other in zip(expected, found, strict=True):
                _expect_same(group, k, one, other)


def _group(
    agents_of: Callable[[Sequence[int]], Agents], robots: Sequence[int], beside: str
) -> _Group:
    agents, numbers = agents_of(robots), np.array(robots)
    moved = {
        name: agents.state[name]
        + APART * keyed_uniform(0, name, numbers, 0, agents.state[name].shape[1])
        for name in ("position", "velocity")
    }
    agents.state = agents.state.replace(**moved)
    return _Group(agents, beside)


def _expect_same(group: _Group, k: int, one: Outcome, other: Outcome) -> None:
    """Raise `AlgorithmError` for what is not the same as all robots together come to."""
    (method, every, expected), (_, robots, found) = one, other
    for name, values in found.items():
        rows = expected[name][np.searchsorted(every, robots)]
        if values.tobytes() == rows.tobytes():
            continue
        wrong = (values != rows) | (np.signbit(values) != np.signbit(rows))
        robot = robots[wrong.reshape(len(robots), -1).any(axis=1)][0]
        if not group.beside:
            by = "when asked once more"
            advice = "draw from now.uniform and now.normal, and keep what there is to keep in STATE"
        else:
            by = f"{group.beside} on a worker than with all"
            rounded = np.allclose(values, rows, ROUNDING, ROUNDING * np.abs(rows).max())
            advice = ROUNDED if rounded else MIXED
        raise wrong_return(
            group.agents.algorithm,
            method,
            f"returned another {name} for robot {robot} {by} at tick {k}; {advice}",
        )
