"""What happens to a sample on its way over a link j → i.

The sample of t_s arrives at t_{s + delay(s)}, as Q(x + noise(s)), where Q rounds to multiples of
the quantisation. It never arrives when it is lost, when the link is in an outage at t_s, when j or
i is in one at t_s (a robot in an outage neither sends nor hears), or when i is in one at its
arrival. None is sent at a t_s whose digraphs have no such link; what is under way then goes on. All
of that is known at t_s. Loss, delay and noise are drawn apart from one another, each keyed by
(seed, purpose, j, i, s): a draw depends neither on who asks, nor on the order, nor on the other
links and faults. Only the links that have faults are kept here.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.outages import Outages, Spans
from nrs_cosim.bus.random_streams import random_stream
from nrs_cosim.bus.topologies import TopologySchedule, edges_among

BLOCK = 64
"""Draws are made for so many sampling times of a link at once, and only these are kept."""

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
    noise: tuple[float, float] = (0.0, 0.0)
    """Standard deviations, of each number of the position and of the velocity."""
    quantisation: tuple[float, float] = (0.0, 0.0)
    """What position and velocity are rounded to multiples of; 0 leaves them as they are."""


@dataclass(frozen=True, slots=True, eq=False)
class LinkOutcome:
    """The outcome of one tick's samples on the links that have faults, (F,) each."""

    lost: Mask
    """By chance."""
    outage: Mask
    """Of the link or an end of it, then or at the arrival."""
    delay: NDArray[np.int64]
    """Sampling periods."""
    absent: Mask
    """Whether there is no sample, for the digraphs of the tick have no such link."""

    @property
    def gone(self) -> Mask:
        """Whether no sample ever arrives."""
        return self.lost | self.outage | self.absent


class Ticks(Protocol):
    """When the sampling times are, ns; see `bus.clock.Clock`."""

    def t(self, k: int) -> int:
        """Return t_k."""

    def since(self, time: int) -> int:
        """Return the first k with t_k >= a time."""


class Links:
    """The links into some robots that have faults, sorted by (robot, in-neighbour).

    `faults` is by link, (j, i), and `silences` by robot; what is not named there has none. Vectors
    have m numbers.
    """

    def __init__(
        self,
        topologies: TopologySchedule,
        robots: NDArray[np.integer],
        faults: Mapping[tuple[int, int], LinkFault],
        silences: Mapping[int, Spans],
        *,
        ticks: Ticks,
        seed: int,
        m: int,
    ) -> None:
        self.ticks = ticks
        topology = topologies.links
        self._nodes = topology.n + 1
        self._silences = Outages.of(silences, ticks.since)
        sound = LinkFault()
        mine = np.isin(topology.sink, robots)
        links = [*zip(topology.source[mine].tolist(), topology.sink[mine].tolist(), strict=True)]
        faulty = [
            edge
            for edge, link in enumerate(links)
            if faults.get(link, sound) != sound or any(silences.get(end) for end in link)
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

        def drawn(rows: NDArray[np.intp], purpose: str, draw: "Draw") -> "Draws":
            return Draws(seed, purpose, [links[row] for row in rows], rows, draw)

        loss = np.array([fault.loss for fault in theirs])
        spread = np.array([fault.noise for fault in theirs]).reshape(-1, 2, 1)
        self._step = np.array([fault.quantisation for fault in theirs]).reshape(-1, 2, 1)
        self._lossy = np.flatnonzero(loss)
        self._late = np.flatnonzero(self._least < self.longest)
        self._noisy = np.flatnonzero(spread.any(axis=(1, 2)))
        self._coarse = np.flatnonzero(self._step.any(axis=(1, 2)))
        self._loss = loss[self._lossy]
        self._spread, self._step = spread[self._noisy], self._step[self._coarse]
        self._losses = drawn(self._lossy, "link loss", lambda rng, _: rng.random(BLOCK))
        self._delays = drawn(
            self._late,
            "link delay",
            lambda rng, row: rng.integers(delays[row, 0], delays[row, 1], BLOCK, endpoint=True),
        )
        self._noise = drawn(
            self._noisy, "link noise", lambda rng, _: rng.standard_normal((BLOCK, 2, m))
        )

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
        for periods in np.unique(delay[delay > 0]).tolist():
            then = self._silences.mask(k + periods, self._nodes)
            outage |= then[self.sink] & (delay == periods)
        return LinkOutcome(lost, outage, delay, self._absent[self._exchange_at(k)])

    def received(self, k: int, sent: Array) -> Array:
        """Return what arrives of the samples of t_k, where any does: (F, 2, m) as `sent`."""
        values = sent.copy()
        if len(self._noisy):
            values[self._noisy] += self._spread * self._noise.at(k)
        coarse = values[self._coarse]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            count = coarse / self._step
            rounded = np.rint(count) * self._step
        # From 2^52 steps on a double has no digits left that the step could round away.
        values[self._coarse] = np.where(np.abs(count) < 2.0**52, rounded, coarse)
        return values


Draw = Callable[[np.random.Generator, int], NDArray[Any]]


class Draws:
    """Draws for one purpose on some links: one generator a link and block of sampling times."""

    def __init__(
        self,
        seed: int,
        purpose: str,
        links: Sequence[tuple[int, int]],
        rows: NDArray[np.intp],
        draw: Draw,
    ) -> None:
        self._seed, self._purpose = seed, purpose
        self._links, self._rows, self._draw = links, rows.tolist(), draw
        self._kept: tuple[int, NDArray[Any]] = -1, np.empty((BLOCK, 0))
        """The last block that was drawn, and its number."""

    def at(self, k: int) -> NDArray[Any]:
        """Return the draws of t_k, (links, …)."""
        number, offset = divmod(k, BLOCK)
        # Links may be shared by runs in several threads: a block is read with its own number.
        kept, block = self._kept
        if self._links and number != kept:
            blocks = [
                self._draw(random_stream(self._seed, self._purpose, *link, number), row)
                for link, row in zip(self._links, self._rows, strict=True)
            ]
            block = np.stack(blocks, axis=1)
            self._kept = number, block
        drawn: NDArray[Any] = block[offset]
        return drawn
