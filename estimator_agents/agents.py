"""An agent takes the samples of its in-neighbours in and gives its own out; no bus is inside.

At t_k (k ≥ 1) its state flows to the left limit, it may look at the target, it sends, it receives
the samples of t_k, and its state is then as its algorithm says. The agents of one worker are kept
as arrays, a row a robot, and each owns the in-edges over which it receives; what is not on them it
never sees. Where the digraphs are switched, a sample is taken in from whoever is ever received, and
what an algorithm is given is over the edges of t_k alone.

Where links have impairments, an agent goes by what its links deliver, if they do (`received`). A
robot in an outage neither sends nor receives: what `send` changed of its state is undone, and it
goes by what it received last if it holds. What a Byzantine robot sends to all is a lie, in place of
what its algorithm says; its own state goes on without it (`lying_agents` lie by another algorithm).
"""

from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.lies import NOTHING_PRETENDED, Lies
from nrs_cosim.bus.links.links import Links
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.estimator_agents.agent_checkpoints import AgentCheckpoints
from nrs_cosim.estimator_agents.algorithm import (
    Algorithm,
    Missing,
    class_of,
    jumped_by,
    jumps,
    overrides,
)
from nrs_cosim.estimator_agents.edges import Edges, field_sizes
from nrs_cosim.estimator_agents.estimate import Disagreement
from nrs_cosim.estimator_agents.flow import acceleration_of, follows_lines
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.receive_buffer import EveryBuffer, ReceiveBuffer
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.returned import expect_returned, wrong_return
from nrs_cosim.estimator_agents.values import (
    Array,
    Values,
    initial_values,
    unflattened,
)

Mask = NDArray[np.bool_]
Nodes = NDArray[np.integer] | slice
Disagree = Callable[[int, Values], Disagreement]
"""Finds the disagreement over the edges of an exchange, from the left limits."""
D = TypeVar("D", bound=Disagree)
_NOTHING = Values()


class Agents:
    """The estimator agents of one worker.

    `state` holds, for the time t_k at which they received last, the fields of the algorithm's
    STATE at t_k⁺, (rows, *shape). `links` are those of the same robots that go through a receive
    buffer, and `missing` says what an agent does where they deliver nothing; over all others a
    sample is received when it is sent. `lies` are what some of the robots tell all.
    """

    def __init__(
        self,
        robots: NDArray[np.integer],
        topologies: TopologySchedule,
        algorithm: Algorithm,
        initial: Values,
        ticks: Clock,
        links: Links | None = None,
        missing: Missing = "hold",
        seed: int = 0,
        lies: Lies | None = None,
    ) -> None:
        self.robots = robots
        self.state = initial
        self.algorithm, self._ticks, self._seed = algorithm, ticks, seed
        self.lies = lies
        self.pretended = NOTHING_PRETENDED
        """What other algorithms say at t_k by which robots lie."""
        self.exchange_at = topologies.at
        """Which exchange there is at t_k."""
        into = {t: Edges.into(robots, t, topologies.links, links) for t in topologies.digraphs}
        self._edges = [(into[e.position], into[e.velocity]) for e in topologies.exchanges]
        """Of positions and of velocities, by exchange."""
        self.in_neighbours = np.unique(np.concatenate([edges.source for edges in into.values()]))
        """From whom samples are received at some time, ascending."""
        self._sizes = field_sizes(topologies, initial.position.shape[1])
        self._checkpoints = AgentCheckpoints(algorithm, self._sizes)
        sent = algorithm.SENT
        self._samples = initial_values(sent, topologies.n + 1, self._sizes)
        """The last that came of each node."""
        self._sent_at = np.zeros(topologies.n + 1, np.int64)
        self._buffer: ReceiveBuffer | EveryBuffer | None = None
        if links and algorithm.ARRIVALS == "every":
            self._buffer = EveryBuffer(links, robots, sent, self._sizes)
        elif links:
            self._buffer = ReceiveBuffer(links, robots, sent, self._sizes, missing)
        sink = topologies.links.sink[np.isin(topologies.links.sink, robots)]
        self._first_link = np.searchsorted(sink, np.append(robots, robots[-1] + 1))
        """(rows + 1,) where the link fields of each robot begin."""
        self._links = initial_values(algorithm.LINK, len(sink), self._sizes)
        self._measured: tuple[int, Mask, Values] | None = None
        """At which tick, by whom, and what by every row."""
        self.observes = self._observes = overrides(class_of(algorithm), "observe")
        """Whether they look at the target, whose sample they then need before they send."""
        self._measures = overrides(class_of(algorithm), "measure")
        self._disagree: Disagree | None = None
        self._is_line = follows_lines(algorithm, self._sizes)
        self._acceleration = acceleration_of(algorithm, self._sizes)

    @property
    def reference(self) -> tuple[Array, ...] | None:
        """Position, velocity and perhaps acceleration, (rows, m), that plants follow from t_k⁺ on.

        None where estimates move neither on lines nor under a constant acceleration.
        """
        line = self.state.position, self.state.velocity
        if self._is_line:
            return line
        return (*line, self.state[self._acceleration]) if self._acceleration else None

    def left(self, dt: float) -> Values:
        """Return the state a time dt, s, after the last t_k⁺, before the next sampling time."""
        return self.algorithm.flow(self.state, dt)

    def receive(self, k: int, nodes: Nodes, samples: Mapping[str, Array]) -> None:
        """Take the samples of k from (s,) nodes, or a range of them: (s, *shape) by field."""
        for name, known in self._samples.items():
            known[nodes] = samples[name]
        self._sent_at[nodes] = k

    def observe(self, k: int, left: Values) -> Values:
        """Return the state after a look at the target, whose sample of t_k is there.

        What a link delivers is looked at, when it delivers something new.
        """
        edges = self._edges[self.exchange_at(k)][0]
        if self._buffer:
            of_target = self._buffer.links.source == 0
            self._buffer.take(k, self._sent_over_links(k), self._who_sends(k), of_target)
        new = edges.source == 0
        if self._buffer:
            new[edges.buffered] &= self._buffer.is_new[edges.link]
        pinned = np.zeros(len(self.robots), bool)
        pinned[edges.row[new]] = True
        delivered = self._delivered(k, edges)
        measured = initial_values(self.algorithm.SENT, len(self.robots), self._sizes)
        for name, values in measured.items():
            values[edges.row[new]] = delivered[name][new]
        return self.algorithm.observe(self._now(k), left, measured, pinned)

    def send(self, k: int, left: Values) -> tuple[Values, Values, Mask | None]:
        """Return the state afterwards, the messages, and who sends, (rows,); None for all."""
        x, messages, who = self.algorithm.send(self._now(k), left)
        if who is not None and not self.algorithm.TRIGGERED:
            raise wrong_return(
                self.algorithm,
                "send",
                "returned who sends; an algorithm that does so declares TRIGGERED = True",
            )
        new = {name: values for name, values in messages.items() if values is not left.get(name)}
        expect_returned(self.algorithm, k, "send", [(new, self._samples, self.robots)])
        if silent := self.silent(k):
            out = np.isin(self.robots, silent)
            who = ~out if who is None else who & ~out
            x = x if x is left else _chosen(out, left, x)
        if self.lies:
            messages = Values(self.lies.sent_instead(k, self._ticks.t(k), messages, self.pretended))
        return x, messages, who

    def jump(self, k: int, left: Values) -> None:
        """Receive the samples of t_k, k after k, with the state after `send`."""
        if self._disagree:
            found = self._disagree(self.exchange_at(k), left)
            self.state = jumped_by(self.algorithm, left, found)
            expect_returned(self.algorithm, k, "receive", [(self.state, left, self.robots)])
            return
        positions, velocities = self._edges[self.exchange_at(k)]
        if self._buffer:
            of = self._buffer.links.source > 0 if self._observes else None
            sent, who = self._sent_over_links(k), self._who_sends(k)
            self._buffer.take(k, sent, who, of, self.pretended)
        if isinstance(self._buffer, EveryBuffer):
            place, received = self._buffer.link, self._arrived(k, self._buffer, positions)
        else:
            over_velocities = None if velocities is positions else self._received(k, velocities)
            place, received = positions.place, self._received(k, positions, over_velocities)
        after = self.algorithm.receive(self._now(k), left, received)
        after, links = after if isinstance(after, tuple) else (after, _NOTHING)
        of_links = self.robots[received.row] if links else self.robots
        returned = [(links, self._links, of_links), (after, left, self.robots)]
        expect_returned(self.algorithm, k, "receive", returned)
        for name, values in links.items():
            self._links[name][place] = values  # of one that is there twice, the last
        self.state = after

    def disagree_by(self, make: Callable[[Sequence[tuple[Edges, Edges]], Values], D]) -> D | str:
        """Let something else find disagreements, to the same bits, where these are all it takes.

        It is made for the edges of positions and velocities, by exchange, and what nodes sent last,
        and returned; or why it is not asked.
        """
        if self._buffer:
            return "links have impairments"
        if class_of(self.algorithm) is not type(self.algorithm):
            return "the algorithm is a plugin's"
        if not jumps(self.algorithm):
            return "the algorithm does more than jump by the disagreement"
        self._disagree = found = make(self._edges, self._samples)
        return found

    def measured(self, k: int) -> tuple[Mask, Values]:
        """Return who is pinned at t_k, (rows,), and what these measure of the target then.

        Its sample of t_k is there.
        """
        pinned, values = self._measurement(k)
        return pinned, values.at(pinned)

    def silent(self, k: int) -> list[int]:
        """Return the robots, of all that there are, that are in an outage at t_k, ascending."""
        return self._buffer.links.silent(k) if self._buffer else []

    @property
    def link_events(self) -> NDArray[np.void] | None:
        """What links did to the samples of the last jump; None where none can do anything."""
        return self._buffer.link_events if self._buffer else None

    def save(self, row: int, left: Values) -> bytes:
        """Return what a robot's agent goes on from at t_k, before it observes or sends there."""
        links = slice(*self._first_link[row : row + 2])
        memory = self._buffer.memory(int(self.robots[row])) if self._buffer else b""
        state, kept = left.at(slice(row, row + 1)), self._links.at(links)
        return self._checkpoints.pack(state, memory, kept, links.stop - links.start)

    def restore(self, checkpoints: Sequence[bytes]) -> Values:
        """Take up what each robot's agent had; return the left limits. Its next jump is at t_k.

        Raises `InputError` for what was not saved by the same algorithm over the same links.
        """
        rows = []
        for row, checkpoint in enumerate(checkpoints):
            robot, links = int(self.robots[row]), slice(*self._first_link[row : row + 2])
            many = links.stop - links.start
            state, memory, kept = self._checkpoints.unpack(robot, checkpoint, many)
            rows.append(state)
            if self._buffer:
                self._buffer.recall(robot, memory)
            elif memory:
                raise InputError(
                    f"the memory of robot {robot} has {len(memory)} bytes, and without faults none "
                    f"were expected; give one that was kept under the same faults"
                )
            for name, values in kept.items():
                self._links[name][links] = values
        return unflattened(np.array(rows), self.algorithm.STATE, self._sizes)

    def _now(self, k: int) -> Now:
        edges = self._edges[self.exchange_at(k)][0]
        t, before = seconds(self._ticks.t(k)), seconds(self._ticks.t(k - 1))
        return Now(
            k,
            t,
            t - before,
            self.robots,
            edges.out_degree,
            (edges.row, edges.source),
            edges.pinned,
            self._seed,
        )

    def _received(self, k: int, edges: Edges, velocities: Received | None = None) -> Received:
        delivered = age = None
        if isinstance(self._buffer, ReceiveBuffer) and len(edges.link):
            delivered = np.ones(len(edges.source), bool)
            delivered[edges.buffered] = self._buffer.present[edges.link]
            age = np.zeros(len(edges.source), np.int64)
            age[edges.buffered] = self._buffer.age(k)[edges.link]
        return Received(
            edges.row,
            edges.start,
            edges.source,
            edges.weight,
            self._delivered(k, edges),
            self._links.at(edges.place) if self._links else _NOTHING,
            delivered,
            age,
            edges.sums,
            velocities,
        )

    def _arrived(self, k: int, buffer: EveryBuffer, edges: Edges) -> Received:
        """Return what arrived at t_k, each sample on an edge of its own; weights add up to 1.

        The buffer has all links that these robots ever receive over, in the order of their places.
        """
        link = buffer.link
        row = np.searchsorted(self.robots, buffer.links.sink[link])
        weights = np.zeros(len(buffer.links.sink))
        weights[edges.place] = edges.weight[:, 0]
        weight = weights[link]
        sums = np.bincount(row, weight, minlength=len(self.robots))
        return Received(
            row,
            np.searchsorted(row, np.arange(len(self.robots))),
            buffer.links.source[link],
            (weight / np.where(sums > 0, sums, 1)[row])[:, None],
            buffer.samples,
            self._links.at(link) if self._links else _NOTHING,
            None,
            buffer.age(k),
        )

    def _delivered(self, k: int, edges: Edges) -> Values:
        """Return what agents go by on each edge, (E, *shape)."""
        samples = self._sent(k, edges.source, edges.row)
        if isinstance(self._buffer, ReceiveBuffer) and len(edges.link):
            for name, values in self._buffer.samples.items():
                samples[name][edges.buffered] = values[edges.link]
        return samples

    def _sent_over_links(self, k: int) -> Values:
        assert self._buffer
        links = self._buffer.links
        return self._sent(k, links.source, np.searchsorted(self.robots, links.sink))

    def _sent(self, k: int, source: NDArray[np.intp], row: NDArray[np.intp]) -> Values:
        """Return what nodes sent last to rows, (E, *shape); of the target, what they measure."""
        samples = self._samples.at(source)
        if self._measures:
            _, measured = self._measurement(k)
            of_target = source == 0
            for name, values in samples.items():
                values[of_target] = measured[name][row[of_target]]
        return samples

    def _measurement(self, k: int) -> tuple[Mask, Values]:
        """Return who is pinned at t_k, and what each row measures; asked for once a tick."""
        if self._measured is None or self._measured[0] != k:
            pinned = np.zeros(len(self.robots), bool)
            for edges in self._edges[self.exchange_at(k)]:
                pinned |= edges.pinned
            target = self._samples.at(0)
            found = self.algorithm.measure(self._now(k), target)
            rows = len(self.robots)
            each = Values(
                {
                    name: np.broadcast_to(found[name], (rows, *of.shape))
                    for name, of in target.items()
                }
            )
            returned = [(each.at(pinned), self._samples, self.robots[pinned])]
            expect_returned(self.algorithm, k, "measure", returned)
            self._measured = k, pinned, each
        return self._measured[1:]

    def _who_sends(self, k: int) -> Mask | None:
        """Return whose sample of t_k there may be, over the links of the buffer; None: all's."""
        if not self._buffer or not self.algorithm.TRIGGERED:
            return None
        source = self._buffer.links.source
        sends: Mask = self._sent_at[source] == k
        return sends | np.isin(source, self.silent(k))


def _chosen(first: Mask, one: Values, other: Values) -> Values:
    """Return the rows of one where `first`, (rows,), else of the other."""
    return Values(
        {
            name: np.where(first.reshape(-1, *[1] * (values.ndim - 1)), one[name], values)
            for name, values in other.items()
        }
    )
