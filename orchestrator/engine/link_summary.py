"""What links did to the samples of a run: as JSON, and on a line.

A run that has link events counts them as they are recorded and says so at its end; of others they
are read.
"""

from collections.abc import Mapping
from itertools import islice
from typing import Any

from nrs_cosim.bus.clock import NS_PER_S
from nrs_cosim.bus.plurals import count_of, numbered
from nrs_cosim.orchestrator.scenario.experiment import Experiment
from nrs_cosim.orchestrator.scenario.tables.algorithms import NotInstalled
from nrs_cosim.recordings.errors import UnreadableError
from nrs_cosim.recordings.export.tables import robots
from nrs_cosim.recordings.link_counts import KINDS, link_counts
from nrs_cosim.recordings.mcap.container import END
from nrs_cosim.recordings.mcap.reader import Reader
from nrs_cosim.recordings.metadata import LINKS, LinkRecord
from nrs_cosim.recordings.schemas import recorded_types

_SPANS = 3
"""Silences that are said one by one."""


def links_of(reader: Reader, experiment: Experiment) -> dict[str, Any] | None:
    """Return what links did, for JSON; None where no link of the run could do anything."""
    if not recorded_types(reader).channels["link_event"]:
        return None
    stored = None if reader.computed else _stored(reader)
    return _described(reader, experiment, stored or link_counts(reader))


def wrong_links(reader: Reader, experiment: Experiment, links: Mapping[str, Any] | None) -> str:
    """Say that what was stored of a whole run is not what its messages give, where it is not."""
    stored = _stored(reader) if reader.computed and reader.digest else None
    if stored is None or (links and _described(reader, experiment, stored) == links):
        return ""
    return f"{END}: {LINKS}: is not what the messages give"


def _stored(reader: Reader) -> LinkRecord | None:
    found, last = reader.ending.links if reader.ending else None, reader.ticks
    for robot, (first, until, count) in (found.silent if found else {}).items():
        whole = 1 <= first <= until <= last and count <= until - first + 1
        if not whole or robot > robots(reader):
            raise UnreadableError(
                f"{reader.path}: {END}: {LINKS}: silent: expected ticks from 1 to {last} of robots "
                f"up to {robots(reader)}, got {count} from {first} to {until} of robot {robot}"
            )
    return found


def _described(reader: Reader, experiment: Experiment, found: LinkRecord) -> dict[str, Any]:
    at = experiment.clock.t
    # Nobody knows how many there were where ticks are missing, or who sends is decided at each t_k,
    # which of an algorithm that is not installed here is not known.
    by_clock = (
        not isinstance(experiment.scenario.algorithm, NotInstalled)
        and not experiment.algorithm.TRIGGERED
    )
    known = by_clock and reader.end_ns == at(reader.ticks)
    return {
        "samples": experiment.topologies.edges_until(reader.ticks) if known else None,
        **{kind: getattr(found, kind) for kind in (*KINDS, "latest")},
        "silent": {
            str(robot): {
                "first": at(first) / NS_PER_S,
                "last": at(last) / NS_PER_S,
                "ticks": count,
                "unbroken": count == last - first + 1,
                "to_the_end": last == reader.ticks,
            }
            for robot, (first, last, count) in found.silent.items()
        },
    }


def links_line(links: Mapping[str, Any]) -> str:
    """Say what links did to samples, and which robots were silent."""
    words = {
        "outage": "in outages",
        "late": f"late (by up to {count_of(links['latest'], 'period')})",
    }
    order = ("lost", "late", "outage", "duplicated", "altered")
    met = [f"{links[kind]:,} {words.get(kind, kind)}" for kind in order if links[kind]]
    of = "" if links["samples"] is None else f"of {links['samples']:,} samples "
    return "; ".join([of + (", ".join(met) or "none met a fault"), *_silences(links["silent"])])


def _silences(silent: Mapping[str, Mapping[str, Any]]) -> list[str]:
    alike: dict[tuple[Any, ...], list[int]] = {}
    for robot, span in silent.items():
        alike.setdefault(tuple(span.values()), []).append(int(robot))
    said = [
        f"{numbered('robot', who, 8)} silent {'' if unbroken else f'at {ticks} sampling times '}"
        f"from {first:g} s to {'the end' if to_the_end else f'{last:g} s'}"
        for (first, last, ticks, unbroken, to_the_end), who in islice(alike.items(), _SPANS)
    ]
    more = sum(map(len, [*alike.values()][_SPANS:]))
    return [*said, *([f"{count_of(more, 'more robot')} silent at times"] if more else [])]
