"""Simulated time advances by data alone: a tick ends when all that it needs was heard.

Tick k: the plants reach t_k, the target and the agents publish their samples of t_k, every agent
hears its in-neighbours and jumps, the recorder closes the tick. Tick 0 has states only.
"""

from collections.abc import Iterator

import numpy as np

from bus.keys import sample_key
from bus.messages import SAMPLE, Codec
from bus.transport import Bus
from estimator_agents.target import Harmonic
from orchestrator.clock import Clock, seconds
from orchestrator.host import Host, Watch
from recordings.recorder import Recorder


class TargetNode:
    """Node 0: it publishes the target's position and velocity at the sampling times."""

    def __init__(self, bus: Bus, clock: Clock, target: Harmonic, m: int) -> None:
        self._clock, self._target = clock, target
        self._codec = Codec(SAMPLE, m)
        self._record = self._codec.blank(np.array([0]))
        self._put = bus.publisher(sample_key(0))

    def publish_sample(self, k: int) -> None:
        """Publish ε_0(t_k), υ_0(t_k)."""
        t = self._clock.t(k)
        at = self._target.at(seconds(t))
        record = self._record
        record["k"], record["time_ns"] = k, t
        record["position"], record["velocity"] = at.position, at.velocity
        self._put(self._codec.encode(record)[0])


def run_ticks(
    clock: Clock, target: TargetNode, host: Host, recorder: Recorder, watch: Watch
) -> Iterator[int]:
    """Run the ticks 0 … K; yield each number once its tick is recorded."""
    host.publish_initial_states()
    recorder.close_tick(0, clock.outputs(0))
    yield 0
    for k in range(1, clock.ticks + 1):
        host.advance(k, watch)
        target.publish_sample(k)
        host.publish_samples(k)
        host.hear(k)
        recorder.close_tick(k, clock.outputs(k), host.agents.silent(k))
        yield k
