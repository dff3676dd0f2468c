"""A worker runs some robots in one process, on one way to the bus: their agents and plants.

At t_k its agents' left limits travel as one batch, the in-neighbours' arrive, the agents jump,
and what else is to be recorded of the tick follows; then the plants advance over (t_k, t_{k+1}].
Data alone makes it wait: it needs the samples of t_k from each worker of an in-neighbour, and the
target's, whose pace keeps all workers within a window of the recorder.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import Clock, seconds
from nrs_cosim.bus.errors import Cause
from nrs_cosim.bus.framing import joined, parted
from nrs_cosim.bus.keys import EVERYONE, RECORDS, SAMPLES, TARGET, wire_key
from nrs_cosim.bus.messages import CHECKPOINT, Blob
from nrs_cosim.bus.transport import Bus, Inbox, Item, Message
from nrs_cosim.bus.validation import Nodes, Records, RejectedError, Tick, Wire
from nrs_cosim.estimator_agents.agents import Agents
from nrs_cosim.estimator_agents.values import Values
from nrs_cosim.orchestrator.engine.native.tick import NativeStates
from nrs_cosim.orchestrator.errors import DivergedError
from nrs_cosim.plant_fmu.errors import FmuError
from nrs_cosim.plant_fmu.fleet import as_slice
from nrs_cosim.plant_fmu.plants import Checkpointed, Plants

Watch = Callable[[int], None]
"""Is told each simulated time, ns, that a worker has reached; may raise `Interrupted`."""

SENDS, RECEIVES = 6, 7
"""What is done in a tick once the plants have moved, in the order of `Worker.place`."""

ReceivedSamples = tuple[int, Records, str]
"""Samples that were received: k, they, and the worker that put them, or `EVERYONE`."""


def needed(in_neighbours: NDArray[np.integer], assignment: Mapping[str, Nodes]) -> frozenset[str]:
    """Return the workers whose samples robots with in-neighbours (d,) need; the target's always."""
    return frozenset(
        h for h, nodes in assignment.items() if np.isin(nodes, in_neighbours).any()
    ) | {TARGET}


class WorkerPlants(Plants, Checkpointed, Protocol):
    """All plants of a worker."""


class Listening(Protocol):
    """How a worker comes by what is not in its inbox."""

    patience: float
    """s: how long to wait for anything at a time."""

    def lack(self, k: int, missing: Sequence[str]) -> Iterable[ReceivedSamples]:
        """Return what is known otherwise of the samples of tick k that workers are missing."""

    def handle(self, item: Item) -> Iterable[ReceivedSamples]:
        """Take an item that is no batch of samples; return the samples that it brings."""


@dataclass(slots=True)
class Spent:
    """Wall time, s."""

    plants: float = 0.0
    bus: float = 0.0
    waiting: float = 0.0


class Worker:
    """The robots of one process. Rows of all arrays are the agents' robots, ascending."""

    def __init__(
        self,
        name: str,
        bus: Bus,
        inbox: Inbox,
        wire: Wire,
        clock: Clock,
        agents: Agents,
        plants: WorkerPlants,
        divergence_limit: float,
        checkpoint_every: int,
        native: NativeStates | None = None,
    ) -> None:
        """Take what it is made of; states are recorded by NumPy unless something native does."""
        self.name = name
        self.agents = agents
        self.plants = plants
        self.left = agents.state
        """What the agents keep at the time that the plants have reached: left limits."""
        self.spent = Spent()
        self._wire, self._clock, self._limit = wire, clock, divergence_limit
        self._every, self._native = checkpoint_every, native
        self._sample = wire.samples.blank(agents.robots)
        self._fields = tuple(wire.samples.kind.fields)
        self._state = wire.states.blank(agents.robots)
        self._of_agents = {
            kind: codec.blank(agents.robots) for kind, codec in wire.of_agents.items()
        }
        self._put_samples = bus.publisher(wire_key(SAMPLES, name))
        self._put_records = bus.publisher(wire_key(RECORDS, name))
        self._inbox = inbox
        self._keys = {wire_key(SAMPLES, worker): worker for worker in wire.assignment}
        self._received: defaultdict[int, dict[str, Records]] = defaultdict(dict)
        """Samples of this tick and later ones, by k and worker."""
        self._needed = needed(agents.in_neighbours, wire.assignment)
        self._wanted = {}
        """Which rows of a worker's samples are in-neighbours', and which nodes these are."""
        for worker in self._needed:
            nodes = wire.assignment[worker]
            rows = np.flatnonzero(np.isin(nodes, agents.in_neighbours))
            self._wanted[worker] = as_slice(rows), as_slice(nodes[rows])
        self.now = 0
        """The tick that it is at."""
        self.place = (0, 0, 0)
        """Where in a tick it is, and fails: the time, ns, what is done then, and for which robot.

        What is done is 0 as the plants move, 1 to 5 as their states are looked at, then `SENDS` and
        `RECEIVES`.

        In one process what comes first in this order would fail first.
        """

    def restore(self, k: int, checkpoints: Sequence[bytes]) -> None:
        """Go back to t_k, before anything was sent there, from a checkpoint of each robot."""
        plants, agents = [], []
        for row, checkpoint in enumerate(checkpoints):
            parts = parted(CHECKPOINT.decode(checkpoint).data)
            if parts is None or len(parts) != 2:
                raise FmuError(f"robot {self.agents.robots[row]}'s checkpoint is damaged")
            plants.append(parts[0])
            agents.append(parts[1])
        self.left = self.agents.restore(agents)
        self.plants.restore(plants)
        self.now = k

    def run(self, recorded: int, watch: Watch, listening: Listening) -> Iterator[int]:
        """Run tick by tick to the end; yield each number once all of it was sent.

        What the recording has already, the ticks up to `recorded` (−1 for none), is not sent again.
        """
        # A checkpoint is of before its tick's samples, which the recording has: none is sent again.
        if self.now:
            self.interact(self.now, listening, sends=False)
        elif recorded < 0:
            self._tell(0, self._states(0, self._clock.t(0)), ())
        yield self.now
        while self.now < self._clock.ticks:
            self.now = k = self.now + 1
            states = self.advance(k, watch)
            # Before the jump: what is restored receives the samples of k anew, and jumps itself.
            checkpoints = self._checkpoints(k) if k > recorded else ()
            self.interact(k, listening, sends=k > recorded)
            if k > recorded:
                self._tell(k, states, checkpoints)
            yield k

    def advance(self, k: int, watch: Watch) -> Records:
        """Advance the plants over (t_{k−1}, t_k]; return their states (outputs · robots,).

        They are on the output grid, by time and then by robot. A reference that plants do not
        follow between sampling times is given to them as its chords there.
        """
        before = self.agents.state
        reached = held = self._clock.t(k - 1)
        reference = self.agents.reference
        if reference:
            self.plants.hold(*reference)
        batches = []
        for t in self._clock.outputs(k):
            began = perf_counter()
            self.place = t, 0, int(self.agents.robots[0])
            start, step = seconds(reached), seconds(t - reached)
            left = self.agents.left(seconds(t - held))
            if not reference:
                self.plants.hold(before.position, (left.position - before.position) / step)
            self.plants.advance(start, step)
            self.spent.plants += perf_counter() - began
            reached, before = t, left
            self.left = left
            batches.append(self._states(k, t))
            watch(t)
        return batches[0] if len(batches) == 1 else np.concatenate(batches)

    def interact(self, k: int, listening: Listening, *, sends: bool) -> None:
        """Do what the agents do at t_k: observe, send, receive all that they need, and jump.

        What the robots send is published if it `sends`; their states change by it all the same.
        """
        left, t = self.left, self._clock.t(k)
        self.place = t, SENDS, int(self.agents.robots[0])
        if self.agents.observes:
            self._await(k, frozenset({TARGET}), listening)
            left = self.agents.observe(k, left)
        left, messages, who = self.agents.send(k, left)
        if sends:
            self._publish(k, messages, who)
        self._await(k, self._needed, listening)
        del self._received[k]
        began = perf_counter()
        self.place = t, RECEIVES, int(self.agents.robots[0])
        self.agents.jump(k, left)
        self.spent.bus += perf_counter() - began

    def _publish(self, k: int, messages: Values, who: NDArray[np.bool_] | None) -> None:
        began = perf_counter()
        records = self._sample
        records["k"], records["time_ns"] = k, self._clock.t(k)
        for name, values in messages.items():
            records[name] = values
        if who is not None:
            records = records[who]
        self._put_samples(self._wire.pack_samples(self.name, k, records))
        self.spent.bus += perf_counter() - began

    def _await(self, k: int, needed: frozenset[str], listening: Listening) -> None:
        """Take the samples of t_k as they come, until none of some workers is missing."""
        began = perf_counter()
        waited = 0.0
        while missing := self._missing(k, needed):
            items = self._inbox.take()
            if not items:
                self._keep(k, listening.lack(k, missing))
                asked = perf_counter()
                items = self._inbox.take(listening.patience)
                waited += perf_counter() - asked
            self.take_in(k, items, listening)
        received = self._received[k]
        # The recording's are of all nodes: beside them nothing else of the tick is needed.
        if EVERYONE in received:
            received = {EVERYONE: received[EVERYONE]}
        for worker, records in received.items():
            if worker in self._wanted and len(records) == len(self._wire.assignment[worker]):
                rows, nodes = self._wanted[worker]
            else:  # fewer than the worker has robots, where some are silent, or of all nodes
                rows = np.flatnonzero(np.isin(records["robot"], self.agents.in_neighbours))
                nodes = records["robot"][rows]
            self.agents.receive(k, nodes, {name: records[name][rows] for name in self._fields})
        self.spent.waiting += waited
        self.spent.bus += perf_counter() - began - waited

    def _missing(self, k: int, needed: frozenset[str]) -> list[str]:
        received = self._received[k].keys()
        return [] if EVERYONE in received else sorted(needed - received)

    def _samples_in(self, item: Item, listening: Listening) -> Iterable[ReceivedSamples]:
        """Return the samples in an item; what is not accepted is passed over.

        The recorder receives it too, and counts it.
        """
        if not isinstance(item, Message) or not (worker := self._keys.get(item.key)):
            return listening.handle(item)
        try:
            each = self._wire.unpack_each(worker, item.payload)
        except RejectedError:
            return ()
        return [(k, records, worker) for k, records in each]

    def _keep(self, now: int, received: Iterable[ReceivedSamples]) -> None:
        """Keep the samples of this tick and later ones."""
        for k, records, worker in received:
            if k >= now:
                self._received[k].setdefault(worker, records)

    def _tell(self, k: int, states: Records, checkpoints: Sequence[bytes]) -> None:
        began = perf_counter()
        events = self.agents.link_events if k else None
        self._put_records(
            self._wire.pack_tick(
                self.name,
                k,
                Tick(
                    states,
                    self._wire.none if events is None else events,
                    checkpoints,
                    self._told_by_agents(k) if k else {},
                ),
            )
        )
        self.spent.bus += perf_counter() - began

    def _told_by_agents(self, k: int) -> dict[str, Records]:
        """Return what agents keep beside their estimates right after t_k, and measured at it."""
        found = {}
        for kind, blank in self._of_agents.items():
            if kind == "measurement":
                pinned, values = self.agents.measured(k)
                records = blank[pinned]
            else:
                records, values = blank.copy(), self.agents.state
            records["k"], records["time_ns"] = k, self._clock.t(k)
            for name in self._wire.of_agents[kind].shapes:
                records[name] = values[name]
            found[kind] = records
        return found

    @property
    def checkpoints_every(self) -> int:
        """Return at every how many ticks robots can be restored; 0 for none."""
        return self._every if self.plants.checkpointable else 0

    def is_checkpoint(self, k: int) -> bool:
        """Return whether robots can be restored from t_k."""
        return bool(self.checkpoints_every and k % self.checkpoints_every == 0)

    def take_in(self, k: int, items: Sequence[Item], listening: Listening) -> None:
        """Keep the samples in what came that are of t_k or later."""
        for item in items:
            self._keep(k, self._samples_in(item, listening))

    def target_ahead(self, k: int) -> Records | None:
        """Return the target's (1, …) sample of t_k, if it came before its time, and forget it."""
        return self._received.pop(k, {}).get(TARGET)

    def _checkpoints(self, k: int) -> Sequence[bytes]:
        """Return what each robot can be restored from at t_k, where that is due and exact."""
        if not self.is_checkpoint(k):
            return ()
        t = self._clock.t(k)
        checkpoints = []
        for row, state in enumerate(self.plants.save()):
            data = joined([state, self.agents.save(row, self.left)])
            robot = int(self.agents.robots[row])
            checkpoints.append(CHECKPOINT.encode(Blob(robot, k, t, data)))
        return checkpoints

    def _states(self, k: int, t: int) -> Records:
        """Return the states of t, ns, once it is seen that they are bounded."""
        if self._native and (found := self._native.records(k, t, self.left)) is not None:
            return found
        self.expect_bounded(t)
        records = self._state.copy()
        records["k"], records["time_ns"] = k, t
        records["position"], records["velocity"] = self.plants.q, self.plants.qd
        records["effort"] = self.plants.tau
        records["reference_position"] = self.left.position
        records["reference_velocity"] = self.left.velocity
        return records

    def expect_bounded(self, t: int) -> None:
        """Raise `DivergedError` for a state of t, ns, that is not bounded."""
        estimates = {
            "estimated position": self.left.position,
            "estimated velocity": self.left.velocity,
            "q": self.plants.q,
            "qd": self.plants.qd,
        }
        for done, (name, values) in enumerate(estimates.items(), 1):
            sizes = np.abs(values)
            if not sizes.max() <= self._limit:  # nor is NaN
                row = int(np.flatnonzero(~(sizes <= self._limit).all(axis=1))[0])
                self.place = t, done, int(self.agents.robots[row])
                raise DivergedError(
                    f"diverged at t = {seconds(t):g} s: robot {self.agents.robots[row]}'s {name} "
                    f"is {values[row].tolist()}, beyond run.divergence_limit = {self._limit:g}",
                    Cause(DivergedError.kind, self.now, t, self.place[2], name),
                )
        finite = np.isfinite(self.plants.tau).all(axis=1)
        if not finite.all():
            row = int(np.flatnonzero(~finite)[0])
            self.place = t, len(estimates) + 1, int(self.agents.robots[row])
            raise DivergedError(
                f"diverged at t = {seconds(t):g} s: robot {self.agents.robots[row]}'s tau is "
                f"{self.plants.tau[row].tolist()}",
                Cause(DivergedError.kind, self.now, t, self.place[2], "tau"),
            )
