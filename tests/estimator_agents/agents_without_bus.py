"""Agents without a bus: made from an estimate, and brought together at a sampling time."""

from collections.abc import Mapping, Sequence

import numpy as np

from nrs_cosim.bus.clock import Clock
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.edges import field_sizes
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.values import Values, initial_values

CLOCK = Clock((100_000_000,), 1, 1_000_000)


def values(estimate: Estimate) -> Values:
    """Return an estimate as the fields of most algorithms."""
    return Values(position=estimate.position, velocity=estimate.velocity)


def agents_at(
    robots, topologies, algorithm, start, links=None, missing="hold", *, ticks=CLOCK, seed=0
) -> Agents:
    """Return the agents of some robots; `start` is an estimate, or some of the fields by name."""
    if isinstance(start, Estimate):
        start = values(start)
    sizes = field_sizes(topologies, np.shape(start["position"])[1])
    state = initial_values(algorithm.STATE, len(robots), sizes)
    state = state.replace(**{name: np.array(value, float) for name, value in start.items()})
    return Agents(np.asarray(robots), topologies, algorithm, state, ticks, links, missing, seed)


def receive(agents: Agents, k, nodes, position, velocity) -> None:
    """Let agents have the position and velocity of some nodes."""
    agents.receive(k, np.asarray(nodes), {"position": position, "velocity": velocity})


def meet(parts: Sequence[Agents], k: int, h: float, target: Mapping[str, np.ndarray]) -> np.ndarray:
    """Let the agents of all parts do what they do at t_k, h s after the last sampling time.

    `target` has what it sends, by field. Returns who sent, ascending.
    """
    lefts = [part.left(h) for part in parts]
    for part in parts:
        part.receive(k, np.array([0]), {name: value[None] for name, value in target.items()})
    lefts = [
        part.observe(k, left) if part.observes else left
        for part, left in zip(parts, lefts, strict=True)
    ]
    sent = [part.send(k, left) for part, left in zip(parts, lefts, strict=True)]
    who = []
    for part, (_, messages, sends) in zip(parts, sent, strict=True):
        rows = np.ones(len(part.robots), bool) if sends is None else sends
        who.append(part.robots[rows])
        for other in parts:
            other.receive(k, part.robots[rows], messages.at(rows))
    for part, (left, _, _) in zip(parts, sent, strict=True):
        part.jump(k, left)
    return np.sort(np.concatenate(who))


def whole(parts: Sequence[Agents], name: str) -> np.ndarray:
    """Return a field of all robots, by number, whoever has them."""
    robots = np.concatenate([part.robots for part in parts])
    return np.concatenate([part.state[name] for part in parts])[np.argsort(robots)]
