"""What an agent does, as numbers: x⁺ = K x + G d at t_k, of the fields x that it keeps, and a flow.

Here d are the disagreements with the in-neighbours' samples, of the fields that it sends: those of
velocities over their own digraph, where they have one. Between sampling times the position moves by
the velocity, and both by an acceleration where it keeps one. K and G are found by asking the
algorithm itself to receive, each axis of m being a case; whatever other cases show to be more than
that is refused.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.fields import Sizes
from nrs_cosim.estimator_agents.algorithm import Algorithm, class_of, overrides
from nrs_cosim.estimator_agents.flow import acceleration_of, follows_lines
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.theory.linear_step import linear_step, why_not_linear
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.plant_fmu.bundled.sampled import SAMPLE, AgentFields

Array = NDArray[np.float64]
CASES = 4096
"""Of random numbers."""


@dataclass(frozen=True, slots=True, eq=False)
class AgentLaw:
    """An agent's algorithm."""

    h: float
    """s"""
    fields: AgentFields
    keep: Array
    """K, a row and a column of each field that it keeps."""
    gain: Array
    """G, a column of each field that it sends."""
    truths: Sequence[str]
    """Which quantity of the target each field that it sends is."""
    exact: bool
    """Whether K x + G d, as C adds it up, is what it computes, to the last bit."""


def law_of(algorithm: Algorithm, sizes: Sizes, h: float, two_digraphs: bool) -> AgentLaw | str:
    """Return an algorithm's law under a sampling period, s, or why it has none."""
    kept = (*SAMPLE, *(name for name in algorithm.STATE if name not in SAMPLE))
    truths = {name: field.truth for name, field in algorithm.SENT.items()}
    acceleration = acceleration_of(algorithm, sizes)
    if not _flows(algorithm, sizes, acceleration):
        return "flows otherwise than by its velocity and a constant acceleration"
    if overrides(class_of(algorithm), "send") or not set(truths) <= set(kept):
        return "sends more than what it keeps"
    if linear_step(algorithm, h) is None:
        raised = why_not_linear(algorithm, h)
        return "does not jump linearly: there is no K and G" + (raised and f" ({raised})")
    if unknown := [name for name, truth in truths.items() if truth is None]:
        return f"sends {unknown[0]}, of which the target has none"
    s, q, random = len(kept), len(truths), np.random.Generator(np.random.Philox(4))
    own = [kept.index(name) for name in truths]
    units = np.eye(s + q)
    found = _jump(algorithm, h, kept, units[:s], units[own] + units[s:], two_digraphs)
    keep, gain = found[:, :s], found[:, s:]
    x, samples = random.normal(size=(s, CASES)), random.normal(size=(q, CASES))
    after = _jump(algorithm, h, kept, x, samples, two_digraphs)
    expected = _added(keep, x) + _added(gain, samples - x[own])
    if not np.allclose(after, expected, rtol=1e-12, atol=1e-12):
        return "does not jump by the disagreements alone: there is no K and G"
    fields = AgentFields(kept, tuple(truths), acceleration)
    exact = np.array_equal(after, expected)
    return AgentLaw(h, fields, keep, gain, [truth for truth in truths.values() if truth], exact)


def _flows(algorithm: Algorithm, sizes: Sizes, acceleration: str | None) -> bool:
    """Return whether position and velocity flow as C has it, and the other fields stay."""
    if not acceleration and not follows_lines(algorithm, sizes):
        return False
    random = np.random.Generator(np.random.Philox(5))
    shapes = {name: (1, *field.size(sizes)) for name, field in algorithm.STATE.items()}
    x = Values({name: random.normal(size=shape) for name, shape in shapes.items()})
    after = algorithm.flow(x, 0.7)
    return all(np.array_equal(x[name], after[name]) for name in shapes if name not in SAMPLE)


def _jump(
    algorithm: Algorithm, h: float, kept: Sequence[str], x: Array, samples: Array, apart: bool
) -> Array:
    """Return what is kept right after t_k, (s, c), of c cases, with one in-neighbour.

    Where velocities have a digraph apart, what is not to be gone by is some number.
    """
    one, rest = np.zeros(1, np.intp), np.full(samples.shape[1], 0.37)
    rows = dict(zip(algorithm.SENT, samples, strict=True))

    def over(digraph: Callable[[str], bool], velocities: Received | None) -> Received:
        given = {name: (row if digraph(name) else rest)[None] for name, row in rows.items()}
        weight, source = np.ones((1, 1)), np.array([2])
        own = Values(given)
        return Received(one, one, source, weight, own, Values(), velocities=velocities)

    received = over(lambda _: True, None)
    if apart:
        received = over(
            lambda name: name != "velocity", over(lambda name: name == "velocity", None)
        )
    now = Now(1, h, h, np.array([1]), np.ones((1, 1)), (one, np.array([2])), np.zeros(1, bool))
    state = Values({name: row[None] for name, row in zip(kept, x, strict=True)})
    after = algorithm.receive(now, state, received)
    assert isinstance(after, Values)  # linear_step has seen that it keeps nothing of a link
    return np.concatenate([after[name] for name in kept])


def _added(matrix: Array, x: Array) -> Array:
    """Return a product, added from the first column to the last."""
    total: Array = matrix[:, :1] * x[0]
    for a, row in zip(matrix.T[1:], x[1:], strict=True):
        total = total + a[:, None] * row
    return total
