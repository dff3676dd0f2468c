"""A host runs some robots in one process, on one session of the bus: their agents and plants.

At t_k its agents publish their left limits, hear their in-neighbours' and jump; then its plants
advance over (t_k, t_{k+1}], and their states on the output grid are published.
"""

from collections.abc import Callable

import numpy as np

from bus.errors import BusError
from bus.keys import SAMPLES, fault_key, sample_key, state_key
from bus.messages import FAULT, SAMPLE, STATE, Codec
from bus.transport import Bus, Put
from estimator_agents.agents import Agents
from orchestrator.clock import Clock, seconds
from orchestrator.errors import DivergedError
from plant_fmu.plants import Plants

Watch = Callable[[int], None]
"""Is told each simulated time, ns, that a host has reached; may raise `Interrupted`."""


class Host:
    """The robots of one process. Rows of all arrays are the agents' robots, ascending."""

    def __init__(
        self, bus: Bus, clock: Clock, agents: Agents, plants: Plants, divergence_limit: float
    ) -> None:
        self.agents = agents
        self.plants = plants
        self.left = agents.estimate
        """ε_i(t), υ_i(t) at the time that the plants have reached: left limits."""
        self._clock = clock
        self._limit = divergence_limit
        m = agents.estimate.position.shape[1]
        self._samples, self._states = Codec(SAMPLE, m), Codec(STATE, m)
        self._sample = self._samples.blank(agents.robots)
        self._state = self._states.blank(agents.robots)
        self._put_sample = [bus.publisher(sample_key(int(robot))) for robot in agents.robots]
        self._put_state = [bus.publisher(state_key(int(robot))) for robot in agents.robots]
        self._faults = Codec(FAULT, m)
        self._put_fault = {robot: bus.publisher(fault_key(robot)) for robot in agents.faulty}
        self._inbox = bus.listen(SAMPLES)
        self._node_of = {sample_key(int(node)): int(node) for node in agents.in_neighbours}

    def publish_initial_states(self) -> None:
        """Publish the states at t_0."""
        self._publish_states(0, self._clock.t(0))

    def advance(self, k: int, watch: Watch) -> None:
        """Advance the plants over (t_{k−1}, t_k] and publish their states on the output grid."""
        estimate = self.agents.estimate
        reached = held = self._clock.t(k - 1)
        self.plants.hold(estimate.position, estimate.velocity)
        for t in self._clock.outputs(k):
            self.plants.advance(seconds(reached), seconds(t - reached))
            reached = t
            self.left = estimate.after(seconds(t - held))
            self._publish_states(k, t)
            watch(t)

    def publish_samples(self, k: int) -> None:
        """Publish ε_i(t_k), υ_i(t_k) of each robot on its own key, unless it is in an outage."""
        records = self._sample
        records["k"], records["time_ns"] = k, self._clock.t(k)
        records["position"], records["velocity"] = self.left.position, self.left.velocity
        puts, silent = self._put_sample, self.agents.silent(k)
        if silent:
            sending = ~np.isin(self.agents.robots, silent)
            puts = [put for put, sends in zip(puts, sending, strict=True) if sends]
            records = records[sending]
        _put_all(puts, self._samples.encode(records))

    def hear(self, k: int) -> None:
        """Take the in-neighbours' samples of t_k, jump, and publish what befell them on the way.

        `BusError` names who is missing.
        """
        node_of, nodes, payloads = self._node_of, [], []
        for key, payload in self._inbox.take():
            if key in node_of:
                nodes.append(node_of[key])
                payloads.append(payload)
        records = self._samples.decode(payloads)
        wrong = (records["k"] != k) | (records["robot"] != nodes)
        if wrong.any():
            at = int(np.flatnonzero(wrong)[0])
            raise BusError(
                f"tick {k}: {sample_key(nodes[at])} carried the sample of robot "
                f"{records['robot'][at]} for k = {records['k'][at]}, which was refused"
            )
        self.agents.hear(k, np.array(nodes, np.intp), records["position"], records["velocity"])
        missing = self.agents.missing(k)
        if missing:
            raise BusError(f"tick {k}: no sample came from node {', '.join(map(str, missing))}")
        self.agents.jump(k, self.left)
        faults = self.agents.faults
        _put_all(
            [self._put_fault[robot] for robot in faults["robot"].tolist()],
            self._faults.encode(faults),
        )

    def _publish_states(self, k: int, t: int) -> None:
        self._expect_bounded(t)
        records = self._state
        records["k"], records["time_ns"] = k, t
        records["q"], records["qd"], records["tau"] = (
            self.plants.q,
            self.plants.qd,
            self.plants.tau,
        )
        records["position"], records["velocity"] = self.left.position, self.left.velocity
        _put_all(self._put_state, self._states.encode(records))

    def _expect_bounded(self, t: int) -> None:
        told = {
            "estimated position": self.left.position,
            "estimated velocity": self.left.velocity,
            "q": self.plants.q,
            "qd": self.plants.qd,
        }
        for name, values in told.items():
            sizes = np.abs(values)
            if not sizes.max() <= self._limit:
                row = int(np.flatnonzero(~(sizes <= self._limit).all(axis=1))[0])
                raise DivergedError(
                    f"diverged at t = {seconds(t):g} s: robot {self.agents.robots[row]}'s {name} "
                    f"is {values[row].tolist()}, beyond run.divergence_limit = {self._limit:g}"
                )
        finite = np.isfinite(self.plants.tau).all(axis=1)
        if not finite.all():
            row = int(np.flatnonzero(~finite)[0])
            raise DivergedError(
                f"diverged at t = {seconds(t):g} s: robot {self.agents.robots[row]}'s tau is "
                f"{self.plants.tau[row].tolist()}"
            )


def _put_all(puts: list[Put], payloads: list[bytes]) -> None:
    for put, payload in zip(puts, payloads, strict=True):
        put(payload)
