"""Agents some of which lie by an algorithm that is not their own, or are lied to so.

Beside its own algorithm a Byzantine robot runs another, with a state of its own: it receives what
the robot does, over the same links, and what it would send at t_k is the lie, in place of what the
robot's own algorithm says. A lie to all is run where its robot is, one to some robots wherever any
of these is: it needs what the liar's in-neighbours send, and not the liar. All copies are the same
to the last bit, and each robot that needs one has its state in its checkpoint.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.bus.lies import Lie
from nrs_cosim.estimator_agents.agents import Agents, Mask, Nodes
from nrs_cosim.estimator_agents.values import Array, Values


@dataclass(frozen=True, slots=True, eq=False)
class OtherAlgorithm:
    """What one robot runs beside its own algorithm to lie by it."""

    lie: Lie
    agent: Agents
    """Of that robot alone."""
    to_all: bool
    needed_by: frozenset[int]
    """Those of the robots here that tell or receive it, or what depends on it."""


class LyingAgents(Agents):
    """The estimator agents of one worker, and the algorithms by which robots lie to them."""

    def __init__(self, others: Sequence[OtherAlgorithm], *agents: Any) -> None:
        """Take other algorithms, by the number of their lies, and what `Agents` takes."""
        super().__init__(*agents)
        self._others = others
        theirs = [other.agent.in_neighbours for other in others]
        self.in_neighbours = np.unique(np.concatenate([self.in_neighbours, *theirs]))
        self.observes |= any(other.agent.observes for other in others)
        self._flow(1)

    def _flow(self, k: int) -> None:
        """Take the other algorithms from t_{k−1}⁺ to the left limits at t_k."""
        dt = seconds(self._ticks.t(k) - self._ticks.t(k - 1))
        self._lefts = [other.agent.left(dt) for other in self._others]

    def receive(self, k: int, nodes: Nodes, samples: Mapping[str, Array]) -> None:
        """Take the samples of k from some nodes, as `Agents`."""
        super().receive(k, nodes, samples)
        for other in self._others:
            other.agent.receive(k, nodes, samples)

    def observe(self, k: int, left: Values) -> Values:
        """Return the state after a look at the target, of those whose algorithm has one."""
        for i, other in enumerate(self._others):
            if other.agent.observes:
                self._lefts[i] = other.agent.observe(k, self._lefts[i])
        return super().observe(k, left) if self._observes else left

    def send(self, k: int, left: Values) -> tuple[Values, Values, Mask | None]:
        """Return the state afterwards, the messages, and who sends; None for all.

        Who lies to all by another algorithm sends when that one does.
        """
        pretended, sends = {}, {}
        for i, other in enumerate(self._others):
            self._lefts[i], messages, their = other.agent.send(k, self._lefts[i])
            pretended[other.lie.number] = messages.at(0)
            if other.to_all and other.lie.since(self._ticks.t(k)) is not None:
                sends[int(other.agent.robots[0])] = their is None or bool(their[0])
        self.pretended = pretended
        x, messages, who = super().send(k, left)
        if who is not None:
            who = np.array([sends.get(int(r), w) for r, w in zip(self.robots, who, strict=True)])
        return x, messages, who

    def jump(self, k: int, left: Values) -> None:
        """Receive the samples of t_k, as `Agents`."""
        super().jump(k, left)
        for other, their in zip(self._others, self._lefts, strict=True):
            other.agent.pretended = self.pretended
            other.agent.jump(k, their)
        self._flow(k + 1)

    def save(self, row: int, left: Values) -> bytes:
        """Return what a robot's agent goes on from, and the algorithms that it needs.

        Of a robot that needs none it is as `Agents` has it, which it may be among elsewhere.
        """
        own = super().save(row, left)
        parts = [
            other.agent.save(0, their)
            for other, their in zip(self._others, self._lefts, strict=True)
            if int(self.robots[row]) in other.needed_by
        ]
        return joined([own, *parts]) if parts else own

    def restore(self, checkpoints: Sequence[bytes]) -> Values:
        """Take up what each robot's agent had, as `Agents`, and the other algorithms."""
        own = []
        for robot, checkpoint in zip(self.robots.tolist(), checkpoints, strict=True):
            needed = [i for i, other in enumerate(self._others) if robot in other.needed_by]
            parts = parted(checkpoint) if needed else [checkpoint]
            if parts is None or len(parts) != 1 + len(needed):
                raise self._checkpoints.not_saved(robot)
            own.append(parts[0])
            for i, saved in zip(needed, parts[1:], strict=True):
                self._lefts[i] = self._others[i].agent.restore([saved])
        return super().restore(own)
