"""What happens to a sample on its way over a link j → i.

The sample of t_s arrives at t_{s + delay(s)}, as Q(x + noise(s)), where Q rounds to multiples of
the quantisation, and x is what j sent, or the lie that it tells i in place of it; where it is
duplicated, two of it arrive. It never arrives when it is lost, when the link is in an outage at
t_s, when j or i is in one at t_s (a robot in an outage neither sends nor receives), or when i is in
one at its arrival. None is sent at a t_s whose digraphs have no such link; what is under way then
goes on. All of that is known at t_s. Loss, delay, duplication and noise are drawn apart from one
another, each keyed by (seed, purpose, j, i, s): a draw depends neither on who asks, nor on the
order, nor on the other links and faults. Noise and quantisation are given by field of the samples.
Only the links that have faults are kept here.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock
from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.lies import NOTHING_PRETENDED, Lie, Lies, Pretended
from nrs_cosim.bus.links.draws import BLOCK, Draw, Draws
from nrs_cosim.bus.links.noise import FieldNoise, Quantisation
from nrs_cosim.bus.links.outages import Outages, Spans
from nrs_cosim.bus.topologies import TopologySchedule, edges_among

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class LinkFault:
    """What is wrong with one link; nothing, unless given."""

    loss: float = 0.0
    """The probability that a sample is lost."""
    delay: tuple[int, int] = (0, 0)
    """Sampling periods, drawn from the least to the most, both included."""
    outages: Spans = ()
    """From and to, ns."""
    noise: Mapping[str, float] = field(default_factory=dict)
    """Standard deviations > 0 of each number of a field, by the field's name."""
    quantisation: Mapping[str, float] = field(default_factory=dict)
    """What each number of a field is rounded to multiples of, > 0."""
    duplicate: float = 0.0
    """The probability that a sample arrives twice, both at once."""
    lies: Sequence[Lie] = ()
    """What a Byzantine robot tells this receiver."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkOutcome:
    """The outcome of one tick's samples on the links that have faults, (F,) each."""

    lost: Mask
    """By chance."""
    outage: Mask
    """Of the link or an end of it, then or at the arrival."""
    delay: NDArray[np.int64]
    """Sampling periods."""
    duplicates: NDArray[np.int64]
    """How many more copies of a sample arrive with it; none of one that never arrives."""
    absent: Mask
    """Whether there is no sample, for the digraphs of the tick have no such link."""

    @property
    def gone(self) -> Mask:
        """Whether no sample ever arrives, (F,)."""
        return self.lost | self.outage | self.absent


class Links:
    """The links into some robots that have faults, sorted by (robot, in-neighbour).

    There are F of them, and `robots` is (r,). `faults` is by link, (j, i), and `silences` by robot;
    what is not named there has none. With `every`, links without faults are here too: over these
    each sample arrives when it is sent. `codecs` are those of the run: what its samples have, and
    what is said of links.
    """

    def __init__(
        self,
        topologies: TopologySchedule,
        robots: NDArray[np.integer],
        faults: Mapping[tuple[int, int], LinkFault],
        silences: Mapping[int, Spans],
        *,
        ticks: Clock,
        seed: int,
        codecs: Codecs,
        every: bool = False,
    ) -> None:
        self.ticks = ticks
        self.codec = codecs.link_events
        """Of the events on these links."""
        topology = topologies.links
        self._nodes = topology.n + 1
        self._silences = Outages.of(silences, ticks.since)
        sound = LinkFault()
        mine = np.isin(topology.sink, robots)
        links = [*zip(topology.source[mine].tolist(), topology.sink[mine].tolist(), strict=True)]
        faulty = [
            edge
            for edge, link in enumerate(links)
            if every or faults.get(link, sound) != sound or any(silences.get(end) for end in link)
        ]
        links = [links[edge] for edge in faulty]
        self.source, self.sink = np.array(links, np.intp).reshape(-1, 2).T
        """(F,) each, j and i of each link."""
        self._exchange_at = topologies.at
        self._absent = [
            np.all(
                [edges_among(t, self.source, self.sink) < 0 for t in (e.position, e.velocity)],
                axis=0,
            )
            for e in topologies.exchanges
        ]
        theirs = [faults.get(link, sound) for link in links]
        cuts = {f: fault.outages for f, fault in enumerate(theirs)}
        self._cuts = Outages.of(cuts, ticks.since)
        delays = np.array([fault.delay for fault in theirs], np.int64).reshape(-1, 2)
        self._least, self.longest = delays.T
        """(F,) the longest delay on each link, sampling periods."""

        def drawn(rows: NDArray[np.intp], purpose: str, draw: Draw) -> Draws:
            return Draws(seed, purpose, links, rows, draw)

        loss = np.array([fault.loss for fault in theirs])
        self._lossy = np.flatnonzero(loss)
        self._late = np.flatnonzero(self._least < self.longest)
        self._loss = loss[self._lossy]
        self._losses = drawn(self._lossy, "link loss", lambda rng, _: rng.random(BLOCK))
        duplicate = np.array([fault.duplicate for fault in theirs])
        self._duplicating = np.flatnonzero(duplicate)
        self._duplicate = duplicate[self._duplicating]
        self._duplicates = drawn(
            self._duplicating, "link duplicate", lambda rng, _: rng.random(BLOCK)
        )
        self._delays = drawn(
            self._late,
            "link delay",
            lambda rng, row: rng.integers(delays[row, 0], delays[row, 1], BLOCK, endpoint=True),
        )
        shapes = codecs.samples.shapes
        deviations, steps = (
            {name: np.array([of.get(name, 0.0) for of in given]) for name in shapes}
            for given in ([f.noise for f in theirs], [f.quantisation for f in theirs])
        )
        self._lies = Lies(seed, [fault.lies for fault in theirs], self.source, self.sink)
        self._noise = FieldNoise(seed, links, shapes, deviations)
        self._quantisation = Quantisation(shapes, steps)

    def silent(self, k: int) -> list[int]:
        """Return the robots, of all that there are, that are in an outage at t_k, ascending."""
        return [int(robot) for robot in self._silences.at(k)]

    def outcome(self, k: int) -> LinkOutcome:
        """Return what becomes of the samples of t_k."""
        lost = np.zeros(len(self.sink), bool)
        lost[self._lossy] = self._losses.at(k) < self._loss
        delay = self._least.copy()
        delay[self._late] = self._delays.at(k)
        silent = self._silences.mask(k, self._nodes)
        outage = self._cuts.mask(k, len(self.sink)) | silent[self.source] | silent[self.sink]
        # Whether its robot receives a late sample is known now, so that its outcome is told once.
        for periods in np.unique(delay[delay > 0]).tolist():
            then = self._silences.mask(k + periods, self._nodes)
            outage |= then[self.sink] & (delay == periods)
        absent = self._absent[self._exchange_at(k)]
        duplicates = np.zeros(len(self.sink), np.int64)
        duplicates[self._duplicating] = self._duplicates.at(k) < self._duplicate
        duplicates[lost | outage | absent] = 0
        return LinkOutcome(lost, outage, delay, duplicates, absent)

    def received(
        self, k: int, sent: Mapping[str, Array], pretended: Pretended = NOTHING_PRETENDED
    ) -> dict[str, Array]:
        """Return what arrives of the samples of t_k, where any does: fields (F, …) as `sent`.

        `pretended` is what algorithms say then by which robots lie.
        """
        instead = self._lies.sent_instead(k, self.ticks.t(k), sent, pretended)
        return {
            name: self._quantisation.rounded(name, self._noise.added(k, name, values))
            for name, values in instead.items()
        }


Sent = Mapping[str, Array]
"""Fields of samples by name, (F, …) each."""


def link_events(
    links: Links,
    robots: NDArray[np.integer],
    k: int,
    outcome: LinkOutcome,
    sent: Sent,
    received: Sent,
    fresh: NDArray[np.bool_] | None = None,
) -> NDArray[np.void]:
    """Return records of the run's link events, by robot and source, on links into robots at t_k.

    They follow from the samples of t_k alone, with no memory: whoever has them can tell. A sample
    has one when it is gone, late, duplicated or altered. `fresh` says on which links there
    is a sample of t_k, (F,): on all unless given.
    """
    altered = np.zeros(len(links.sink), bool)
    for name, values in sent.items():
        altered |= (received[name] != values).any(axis=tuple(range(1, values.ndim)))
    there = ~outcome.absent if fresh is None else fresh & ~outcome.absent
    changed = outcome.gone | (outcome.delay > 0) | (outcome.duplicates > 0) | altered
    of = np.flatnonzero(changed & there)
    silent = np.intersect1d(robots, links.silent(k))
    records = links.codec.blank(np.concatenate([links.sink[of], silent]))
    records["k"], records["time_ns"] = k, links.ticks.t(k)
    records["source"] = np.concatenate([links.source[of], silent])
    on_links, alone = records[: len(of)], records[len(of) :]
    on_links["lost"], on_links["outage"] = outcome.lost[of], outcome.outage[of]
    on_links["delay"] = outcome.delay[of]
    if "duplicates" in links.codec.kind.counts:
        on_links["duplicates"] = outcome.duplicates[of]
    arrives = of[~outcome.gone[of]]
    for name, values in received.items():
        on_links[name][~outcome.gone[of]] = values[arrives]
    alone["outage"] = 1
    return records[np.lexsort((records["source"], records["robot"]))]
