"""What the Byzantine robots of a scenario say, to all the same or to some that receive from them.

One that lies by another algorithm runs it beside its own, with a state of its own. Where it is told
to some robots, what it receives may itself be told to it by such a lie, and so on.
"""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import inf

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.lies import Lie
from nrs_cosim.bus.text import nearest, shortened
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.orchestrator.scenario.faults import spans_of, wrong_spans
from nrs_cosim.orchestrator.scenario.tables.algorithms import AlgorithmTable
from nrs_cosim.orchestrator.scenario.tables.faults import ByzantineRobot
from nrs_cosim.orchestrator.scenario.tables.scenario import Scenario

InitialSample = Callable[[int], Mapping[str, NDArray[np.float64]]]
"""What a robot would send at t_0, by field."""


@dataclass(frozen=True, slots=True)
class OwnLie:
    """A lie, who tells it, and to whom: to all the same where nobody is named."""

    robot: int
    to: tuple[int, ...]
    lie: Lie
    algorithm: AlgorithmTable | None = None
    """By which it lies; None for any other lie."""

    def loaded(self) -> Algorithm:
        """Return that algorithm; `InputError` where it is not here as it was recorded."""
        assert self.algorithm
        try:
            return self.algorithm.loaded()
        except InputError as error:
            raise InputError(f"faults.byzantine[{self.lie.number}].{error}") from error


def needed_algorithms(lies: Sequence[OwnLie], robots: Collection[int]) -> list[OwnLie]:
    """Return the lies by algorithms that some robots tell all or are told, and what these need."""
    found: list[OwnLie] = []
    wanted = {*robots}
    liars = [own for own in lies if own.algorithm]
    while new := [
        own
        for own in liars
        if own not in found and (wanted & {*own.to} or (not own.to and own.robot in robots))
    ]:
        found += new
        wanted |= {own.robot for own in new}
    return sorted(found, key=lambda own: own.lie.number)


def lies_of(scenario: Scenario, sent: Collection[str], initial: InitialSample) -> list[OwnLie]:
    """Return the lies of a scenario, in their order; samples have the `sent` fields."""
    found = []
    for number, entry in enumerate(scenario.faults.byzantine):
        if entry.algorithm:
            values: Mapping[str, NDArray[np.float64]] = {}
        elif entry.value is None:
            values = initial(entry.robot)
        else:
            by_field = entry.value if isinstance(entry.value, dict) else None
            given = dict.fromkeys(sent, entry.value) if by_field is None else by_field
            values = {name: np.array(value, float) for name, value in given.items()}
        lie = Lie(number, entry.kind, values, spans_of(entry.times))
        found.append(OwnLie(entry.robot, entry.to or (), lie, entry.algorithm))
    return found


def byzantine_robots(scenario: Scenario) -> list[int]:
    """Return the robots that lie at some time to some robot, ascending."""
    return sorted({entry.robot for entry in scenario.faults.byzantine})


def wrong_byzantine(
    scenario: Scenario, topology: Topology | None, sent: Collection[str]
) -> Iterator[str]:
    """Yield what is wrong with Byzantine robots; with whom they tell only with a topology.

    `sent` are the fields of samples, none where they are not known.
    """
    n = scenario.n
    for i, entry in enumerate(scenario.faults.byzantine):
        here = f"faults.byzantine[{i}]"
        if entry.robot > n:
            yield f"{here}.robot: expected 1 to {n}, got {entry.robot}"
        elif topology:
            yield from _wrong_receivers(here, entry, topology)
        yield from _wrong_value(here, entry, sent)
        yield from wrong_spans(f"{here}.times", entry.times)
    liars = byzantine_robots(scenario)
    if liars == list(range(1, n + 1)):
        yield "faults.byzantine: expected an honest robot, but all of them lie"


def _wrong_receivers(here: str, entry: ByzantineRobot, topology: Topology) -> Iterator[str]:
    receivers = topology.sink[topology.source == entry.robot].tolist()
    known: set[int] = set()
    for place, robot in enumerate(entry.to or ()):
        if robot in known:
            yield f"{here}.to[{place}]: robot {robot} has been given before"
        elif robot not in receivers:
            one = f"one of {', '.join(map(str, receivers))}, who" if receivers else "a robot that"
            none = "" if receivers else ", but none does"
            end = f"receive{'s' * (not receivers)} from robot {entry.robot}{none}"
            yield f"{here}.to[{place}]: expected {one} {end}, got {robot}"
        known.add(robot)


def _wrong_value(here: str, entry: ByzantineRobot, sent: Collection[str]) -> Iterator[str]:
    value = entry.value
    if entry.kind == "algorithm":
        if entry.algorithm is None:
            yield f"{here}.algorithm: missing; give its name and parameters, as in [algorithm]"
        if value is not None:
            yield f"{here}.value: expected none beside an algorithm, got {value!r}"
        return
    if entry.algorithm:
        yield f'{here}.algorithm: expected none of kind {entry.kind}; give kind = "algorithm"'
    if value is None and entry.kind != "stuck":
        yield f"{here}.value: missing; {entry.kind} needs a number, or one by field"
    by_field = value if isinstance(value, dict) else {}
    for name in by_field if sent else ():
        if name not in sent:
            yield f"{here}.value.{shortened(name)}: unknown key{nearest(name, [*sent])}"
    least = min(by_field.values(), default=inf) if isinstance(value, dict) else value
    if entry.kind == "noise" and least is not None and least < 0:
        yield f"{here}.value: expected a standard deviation >= 0, got {least:g}"
