"""The algorithms that move a robot by its disagreement alone, to the bit as they always did.

Noise was drawn anew since, by the inverse of Φ.
"""

from hashlib import sha256
from itertools import product

import numpy as np
import pytest

from nrs_cosim.bus.codecs import Codecs
from nrs_cosim.bus.fields import Sizes
from nrs_cosim.bus.links.links import LinkFault, Links
from nrs_cosim.bus.topologies import InteractionGraphs, TopologySchedule
from nrs_cosim.bus.topology import Topology
from nrs_cosim.estimator_agents.estimate import Estimate
from nrs_cosim.estimator_agents.installed import load_algorithm
from tests.estimator_agents.agents_without_bus import CLOCK, agents_at, meet, whole

N, M, H, TICKS = 60, 2, 0.1, 60
FAULTS = {
    "none": None,
    "loss": LinkFault(loss=0.3),
    "loss and delay": LinkFault(loss=0.1, delay=(0, 3)),
    "noise": LinkFault(noise={"position": 0.01, "velocity": 0.02}, quantisation={"position": 1e-3}),
}
RECORDED = {
    ("dcea1", "constant", "none"): ("f6cf1346403ab9a6", "f6cf1346403ab9a6"),
    ("dcea1", "constant", "loss"): ("ce80f4b750721ff4", "16221dd49f6a63e1"),
    ("dcea1", "constant", "loss and delay"): ("9cd4fad5bb494875", "467a28b443536d4c"),
    ("dcea1", "constant", "noise"): ("52e61e43fcbfe1ce", "b4458d5c631f27c9"),
    ("dcea1", "switching", "none"): ("ce1b526ac825dfca", "ce1b526ac825dfca"),
    ("dcea1", "switching", "loss"): ("8a73b72f6591e609", "261b85401428de9c"),
    ("dcea1", "switching", "loss and delay"): ("61cce073deba1804", "df9545f2ca925b29"),
    ("dcea1", "switching", "noise"): ("68e8e556b93db6ff", "40a807b565353c88"),
    ("dcea1", "separate", "none"): ("be55d23eaedd1f63", "be55d23eaedd1f63"),
    ("dcea1", "separate", "loss"): ("ff442651b629ca3a", "494b4c195d9689cb"),
    ("dcea1", "separate", "loss and delay"): ("e0f3a25258d4a235", "3c6f736752242c86"),
    ("dcea1", "separate", "noise"): ("ed09c0309b298f56", "1f71bf85ae229c2b"),
    ("dcea2", "constant", "none"): ("2a66cdbc13ff4bb2", "2a66cdbc13ff4bb2"),
    ("dcea2", "constant", "loss"): ("6e8fa30d06b8a704", "478aa902e26f0416"),
    ("dcea2", "constant", "loss and delay"): ("846b1efa918456d0", "3951a9ee2df11d41"),
    ("dcea2", "constant", "noise"): ("59ed829c24845bfb", "30405defae8addd4"),
    ("dcea2", "switching", "none"): ("cf7723f8a16e9342", "cf7723f8a16e9342"),
    ("dcea2", "switching", "loss"): ("ee80edb0cc196a7c", "7ec5c7f26574a0a2"),
    ("dcea2", "switching", "loss and delay"): ("fcdd31ddacda7851", "95468759867c639b"),
    ("dcea2", "switching", "noise"): ("e84f4056db2b36be", "460da1d115b34f27"),
    ("impulsive", "constant", "none"): ("8d0f9f6398cc8e79", "8d0f9f6398cc8e79"),
    ("impulsive", "constant", "loss"): ("31e9825c6504442c", "ce5bee09c8035296"),
    ("impulsive", "constant", "loss and delay"): ("277e72880b7747f8", "ad0bd2671b6dfa86"),
    ("impulsive", "constant", "noise"): ("eb8411c7b260855a", "333af28445a177f5"),
    ("impulsive", "switching", "none"): ("ce9bbc9fadfd3818", "ce9bbc9fadfd3818"),
    ("impulsive", "switching", "loss"): ("66623bfcd146fe56", "0413d9179f499951"),
    ("impulsive", "switching", "loss and delay"): ("d743a253a13d0ab7", "2dced3859e15a38f"),
    ("impulsive", "switching", "noise"): ("699d83f64dccd864", "769cf4559f68f96d"),
    ("pd_like", "constant", "none"): ("34107230cf4d431f", "34107230cf4d431f"),
    ("pd_like", "constant", "loss"): ("1285248b2be79e15", "4712edf898f4cee3"),
    ("pd_like", "constant", "loss and delay"): ("c22b44015e5222d3", "fa4fbb864d41719e"),
    ("pd_like", "constant", "noise"): ("612931192c93bfaf", "39a4d4d04f6b3400"),
    ("pd_like", "switching", "none"): ("0e3e425db3214645", "0e3e425db3214645"),
    ("pd_like", "switching", "loss"): ("0e22cd012a05db75", "f6d19a9437483a12"),
    ("pd_like", "switching", "loss and delay"): ("563747bc5c111f9a", "f37f68d1b4d5fd37"),
    ("pd_like", "switching", "noise"): ("5ababd2f0e006b36", "7cafb86e8f2f1285"),
    ("sliding", "constant", "none"): ("87d400146c9adf94", "87d400146c9adf94"),
    ("sliding", "constant", "loss"): ("2a24b3bdf4fcb8bb", "b649f4d8db3658e2"),
    ("sliding", "constant", "loss and delay"): ("2a1c7eded0e4d06e", "eb820a16397ebd60"),
    ("sliding", "constant", "noise"): ("4eb6c8cfea58c623", "f34bec4606ef0392"),
    ("sliding", "switching", "none"): ("472e16b32ea2d334", "472e16b32ea2d334"),
    ("sliding", "switching", "loss"): ("e9cab0b8bde59d95", "652f6d1942f6458f"),
    ("sliding", "switching", "loss and delay"): ("5ab08d6dd1165ca6", "ce68564673332576"),
    ("sliding", "switching", "noise"): ("4e424331de18ee8f", "024f002f9395ddb7"),
    ("sliding", "separate", "none"): ("19d4d68332d858c9", "19d4d68332d858c9"),
    ("sliding", "separate", "loss"): ("bc7e585403c4697d", "e31236c9c0ebca58"),
    ("sliding", "separate", "loss and delay"): ("79792983728fd68d", "81c3febe8d3ba830"),
    ("sliding", "separate", "noise"): ("d35ceea89a20c13c", "a9abb5f2e07d9c2c"),
}
"""Of each algorithm, digraph and fault, SHA-256 of all estimates, with hold and with drop."""


def digraph(seed: int) -> Topology:
    rng = np.random.Generator(np.random.Philox(seed))
    sink = np.repeat(np.arange(1, N + 1), 3)
    source = np.concatenate(
        [rng.choice(np.delete(np.arange(N + 1), i), 3, replace=False) for i in range(1, N + 1)]
    )
    order = np.lexsort((source, sink))
    weight = rng.uniform(0.5, 2, 3 * N)[order]
    return Topology.of_edges(N, source[order], sink[order], weight)


ONE, TWO = digraph(4), digraph(5)
GRAPHS = {
    "constant": TopologySchedule.constant(ONE),
    "switching": TopologySchedule.of(
        [InteractionGraphs.of(ONE), InteractionGraphs.of(TWO)], (1, 4), 6
    ),
    "separate": TopologySchedule.of([InteractionGraphs(ONE, TWO)]),
}


def digest(name, graphs, fault, missing, parts):
    """Return the digest of 60 ticks of 60 robots, in some parts, robot 7 out for the second."""
    rng = np.random.Generator(np.random.Philox(6))
    start = Estimate(rng.normal(size=(N, M)), rng.normal(size=(N, M)))
    schedule, union = GRAPHS[graphs], GRAPHS[graphs].links
    algorithm = load_algorithm(name, {"alpha": 0.7, "beta": 1.0 if name == "pd_like" else 0.6})
    links = {}
    if FAULTS[fault]:
        pairs = zip(union.source.tolist(), union.sink.tolist(), strict=True)
        links = dict.fromkeys(pairs, FAULTS[fault])
    agents = []
    for robots in parts:
        mine = Links(
            schedule,
            robots,
            links,
            {7: ((10**9, 2 * 10**9),)} if links else {},
            ticks=CLOCK,
            seed=5,
            codecs=Codecs.of(Sizes(M)),
        )
        own = Estimate(start.position[robots - 1], start.velocity[robots - 1])
        agents.append(agents_at(robots, schedule, algorithm, own, mine if links else None, missing))
    sha = sha256()
    for k in range(1, TICKS + 1):
        t = k * H
        target = {"position": np.array([2 * t, t * t - 3]), "velocity": np.array([2, 2 * t])}
        meet(agents, k, H, target)
        for field in ("position", "velocity"):
            sha.update(whole(agents, field).astype("<f8").tobytes())
    return sha.hexdigest()[:16]


@pytest.mark.parametrize(("name", "graphs", "fault"), RECORDED)
def test_estimates_are_those_that_were_recorded(name, graphs, fault):
    together = [np.arange(1, N + 1)]
    found = tuple(digest(name, graphs, fault, how, together) for how in ("hold", "drop"))
    assert found == RECORDED[name, graphs, fault]


def test_they_are_on_any_partition_of_the_robots():
    label = np.random.Generator(np.random.Philox(7)).integers(0, 7, N)
    parts = [np.flatnonzero(label == part) + 1 for part in range(7)]
    for fault, (place, missing) in product(FAULTS, enumerate(("hold", "drop"))):
        found = digest("dcea2", "switching", fault, missing, parts)
        assert found == RECORDED["dcea2", "switching", fault][place]
