"""What a scenario's faults come to on each link: later entries replace what earlier ones gave.

An entry names the links from a node, to a robot, or both, and all links if neither; on each of
them its keys, and only these, take the place of what was given before.
"""

from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import nanoseconds
from nrs_cosim.bus.links.links import LinkFault
from nrs_cosim.bus.links.outages import Spans
from nrs_cosim.bus.text import nearest, shortened
from nrs_cosim.bus.topology import Topology
from nrs_cosim.orchestrator.scenario.tables.faults import FaultyLink, Span, WholeUniform
from nrs_cosim.orchestrator.scenario.tables.scenario import Scenario

_BY_FIELD = ("noise", "quantisation")
"""Keys of a link that may be given by field."""


def link_faults(
    scenario: Scenario, topology: Topology, sent: Collection[str]
) -> dict[tuple[int, int], LinkFault]:
    """Return what is wrong with each link (j, i) that an entry names; samples have the `sent`."""
    given: dict[tuple[int, int], dict[str, Any]] = {}
    for entry in scenario.faults.links:
        values, named = _values(entry, sent), _named(entry, topology)
        links = zip(topology.source[named].tolist(), topology.sink[named].tolist(), strict=True)
        for link in links:
            given.setdefault(link, {}).update(values)
    return {link: LinkFault(**values) for link, values in given.items()}


def silences(scenario: Scenario) -> dict[int, Spans]:
    """Return the outages (ns) of each robot that has any."""
    return {robot.id: spans_of(robot.outages) for robot in scenario.faults.robots if robot.outages}


def wrong_faults(
    scenario: Scenario, topology: Topology | None, sent: Collection[str]
) -> Iterator[str]:
    """Yield what is wrong with the faults; with their links only where there is a topology.

    `sent` are the fields of samples, none where they are not known.
    """
    n = scenario.n
    known: dict[int, int] = {}
    for i, entry in enumerate(scenario.faults.links):
        here = f"faults.links[{i}]"
        ends = {"from": (entry.from_, 0), "to": (entry.to, 1)}
        wrong = [
            f"{here}.{name}: expected {least} to {n}, got {end}"
            for name, (end, least) in ends.items()
            if end is not None and not least <= end <= n
        ]
        yield from wrong
        if topology and not wrong and not _named(entry, topology).any():
            yield f"{here}: {_no_link(entry, topology)}"
        if (
            isinstance(entry.delay, WholeUniform)
            and entry.delay.uniform[0] > entry.delay.uniform[1]
        ):
            yield (
                f"{here}.delay.uniform: expected [low, high] with low <= high, "
                f"got {list(entry.delay.uniform)}"
            )
        yield from wrong_spans(f"{here}.outages", entry.outages)
        yield from _wrong_fields(here, entry, sent)
    for i, robot in enumerate(scenario.faults.robots):
        here = f"faults.robots[{i}]"
        if not 1 <= robot.id <= n:
            yield f"{here}.id: expected 1 to {n}, got {robot.id}"
        if robot.id in known:
            yield (
                f"{here}.id: robot {robot.id} has been given before; "
                f"give all its outages in faults.robots[{known[robot.id]}]"
            )
        known.setdefault(robot.id, i)
        yield from wrong_spans(f"{here}.outages", robot.outages)


def _wrong_fields(here: str, entry: FaultyLink, sent: Collection[str]) -> Iterator[str]:
    for what in _BY_FIELD:
        given = getattr(entry, what)
        for name in given if sent and isinstance(given, dict) else ():
            if name not in sent:
                yield f"{here}.{what}.{shortened(name)}: unknown key{nearest(name, [*sent])}"


def wrong_spans(here: str, spans: tuple[Span, ...]) -> Iterator[str]:
    """Yield which spans of time are no such ones."""
    for i, span in enumerate(spans):
        try:
            start, end = (nanoseconds(time) for time in span)
        except ValueError as error:
            yield f"{here}[{i}]: expected whole nanoseconds, but {error}"
            continue
        if start >= end:
            yield f"{here}[{i}]: expected [from, to] in s with from < to, got {list(span)}"


def _no_link(entry: FaultyLink, topology: Topology) -> str:
    if entry.to is None:
        return f"expected a link of the network, but no robot receives from node {entry.from_}"
    received = ", ".join(map(str, topology.in_neighbours(entry.to)))
    return (
        f"expected a link of the network, but robot {entry.to} does not receive from "
        f"node {entry.from_}; it receives from {received or 'nobody'}"
    )


def _named(entry: FaultyLink, topology: Topology) -> NDArray[np.bool_]:
    """Return which edges an entry names, (E,)."""
    named = np.ones(len(topology.source), bool)
    if entry.from_ is not None:
        named &= topology.source == entry.from_
    if entry.to is not None:
        named &= topology.sink == entry.to
    return named


def _values(entry: FaultyLink, sent: Collection[str]) -> dict[str, Any]:
    """Return the keys that an entry gives, as a `LinkFault` takes them."""
    values: dict[str, Any] = {}
    for name in entry.model_fields_set - {"from_", "to"}:
        value = getattr(entry, name)
        if name == "delay":
            value = value.uniform if isinstance(value, WholeUniform) else (value, value)
        elif name == "outages":
            value = spans_of(value)
        elif name in _BY_FIELD:
            of = value if isinstance(value, dict) else dict.fromkeys(sent, value)
            value = {field: extent for field, extent in of.items() if extent}
        values[name] = value
    return values


def spans_of(spans: tuple[Span, ...]) -> Spans:
    """Return spans of time in ns."""
    return tuple((nanoseconds(start), nanoseconds(end)) for start, end in spans)
