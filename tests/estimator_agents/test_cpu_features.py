"""Agents come to the same bits whichever of the processor's instructions libraries take.

NumPy has loops of its own for several kinds of processors, and takes the best that the machine has.
Some of them differ in the last bit, as those of `exp` do. Without them it is as on another machine.
"""

import json
import os
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from numpy._core import _multiarray_umath as numpy_core

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.topologies import TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.edges import field_sizes
from nrs_cosim.estimator_agents.installed import bundled_algorithms, load_algorithm
from nrs_cosim.estimator_agents.values import initial_values
from tests.estimator_agents.agents_without_bus import CLOCK, agents_at, meet

ROBOTS, AXES, TICKS, H = 30, 3, 10, 0.1
GAINS = {"alpha": 0.7, "beta": 0.6}
PARAMETERS = {
    "dcea1": GAINS,
    "dcea2": GAINS,
    "dcea3": {**GAINS, "gamma": 0.5},
    "dynamic_average": {"gamma": 0.3, "kp": 0.02, "ki": 0.02},
    "event_triggered": {**GAINS, "c0": 0.1, "d0": 0.1, "c1": 1.0},
    "impulsive": GAINS,
    "kalman_consensus": {"q": 1.0, "r": 1e-2, "epsilon": 0.5},
    "max_consensus": {},
    "pd_like": {"alpha": 0.7, "beta": 1.0},
    "pi_consensus": {**GAINS, "kappa": 0.2},
    "push_sum": {},
    "sliding": GAINS,
    "wmsr": {"F": 1},
}
FAULT = LinkFault(loss=0.1, delay=(0, 2))
NOISE = LinkFault(noise={"position": 0.01, "velocity": 0.02}, quantisation={"position": 1e-3})


def digests() -> dict[str, str]:
    """Return SHA-256 of all that agents keep, by algorithm, over links with faults too."""
    rng = np.random.Generator(np.random.Philox(1))
    sources = [
        rng.choice(np.delete(np.arange(ROBOTS + 1), i), 10, replace=False)
        for i in range(1, ROBOTS + 1)
    ]
    edges = [(j, i) for i, row in enumerate(sources, 1) for j in sorted(row.tolist())]
    source, sink = np.array(edges).T
    topology = Topology.of_edges(ROBOTS, source, sink, rng.uniform(0.5, 2, len(edges)))
    return {
        f"{name} {fault}": _digest(name, TopologySchedule.constant(topology), fault)
        for name in bundled_algorithms()
        for fault in (None, *([NOISE] if "beta" in PARAMETERS[name] else []), FAULT)
    }


def _digest(name, topologies, fault):
    algorithm, robots = load_algorithm(name, PARAMETERS[name]), np.arange(1, ROBOTS + 1)
    rng = np.random.Generator(np.random.Philox(2))
    start = {
        field: rng.uniform(-3, 3, (ROBOTS, AXES))
        for field, declared in algorithm.STATE.items()
        if declared.shape == ("m",)
    }
    links = None
    if fault or algorithm.TRIGGERED:
        union = topologies.links
        pairs = zip(union.source.tolist(), union.sink.tolist(), strict=True)
        codecs = Codecs.of(Sizes(AXES), name, algorithm.SENT, algorithm.STATE)
        links = Links(
            topologies,
            robots,
            dict.fromkeys(pairs, fault or LinkFault()),
            {},
            ticks=CLOCK,
            seed=3,
            codecs=codecs,
            every=True,
        )
    agents = agents_at(robots, topologies, algorithm, start, links, algorithm.MISSING[0], seed=4)
    none = initial_values(algorithm.SENT, 1, field_sizes(topologies, AXES)).at(0)
    sha = sha256()
    for k in range(1, TICKS + 1):
        t = k * H
        truth = {"position": t * t, "velocity": 2 * t, "acceleration": 2.0}
        target = {
            field: none[field] + (truth[declared.truth] if declared.truth else 0.0)
            for field, declared in algorithm.SENT.items()
        }
        meet([agents], k, H, target)
        for values in agents.state.values():
            sha.update(values.astype("<f8").tobytes())
    return sha.hexdigest()


def there() -> list[str]:
    """Return the kinds of instructions that NumPy has loops for, and that it takes."""
    return [name for name in numpy_core.__cpu_dispatch__ if numpy_core.__cpu_features__[name]]


def test_without_what_numpy_takes_of_this_processor_all_algorithms_have_the_same_bits():
    if not (taken := there()):
        pytest.skip("NumPy takes nothing of this processor that another might lack")
    assert PARAMETERS.keys() == {*bundled_algorithms()}
    code = f"from {__name__} import *; print(json.dumps([there(), digests()]))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parents[2],
        env=os.environ
        | {
            "NPY_DISABLE_CPU_FEATURES": " ".join(taken),
            "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX512F",
        },
        capture_output=True,
        check=True,
        text=True,
    )
    left, without = json.loads(done.stdout)
    assert left == []
    assert without == digests()
