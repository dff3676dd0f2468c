"""Laws of the literature, written as a user would, against values that are known otherwise."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pytest

from nrs_cosim.bus.fields import Field
from nrs_cosim.bus.links.links import LinkFault
from nrs_cosim.estimator_agents.algorithm import Algorithm
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.values import Values
from tests.estimator_agents.agents_without_bus import meet, whole
from tests.estimator_agents.test_bundled import H, chain, complete, made, schedule, target_of


@dataclass(frozen=True)
class Signs(FirstOrder):
    """Finite-time consensus: weighted signs of the differences."""

    def receive(self, now, x, received):  # noqa: ARG002
        signs = np.sign(received.difference("position", x.position))
        return x.replace(position=x.position + self.alpha * received.mean(signs))


def test_signs_of_differences_step_by_their_weights():
    start = {"position": np.array([[0.0], [1.0], [2.0], [5.0]])}
    agents = made(Signs(0.25, 1.0), complete(4), start)
    meet(agents, 1, H, target_of(Signs(0.25, 1.0)))
    want = [0.25, 1 + 0.25 / 3, 2 - 0.25 / 3, 4.75]
    np.testing.assert_allclose(whole(agents, "position")[:, 0], want, rtol=1e-15)


@dataclass(frozen=True)
class Extrapolating(FirstOrder):
    """A late sample is moved on by its velocity."""

    def receive(self, now, x, received):
        late = (received.age * now.h)[:, None]
        ahead = received.samples.position + late * received.samples.velocity
        return x.replace(
            position=x.position + self.alpha * received.mean(ahead - received.own(x.position)),
            velocity=x.velocity + self.beta * received.disagreement("velocity", x.velocity),
        )


@pytest.mark.parametrize(
    ("algorithm", "errors"),
    [(FirstOrder(0.5, 0.5), [-0.4, -0.8, -1.2]), (Extrapolating(0.5, 0.5), [0.0, 0.0, 0.0])],
)
def test_a_ramp_over_links_two_periods_late_is_off_by_them_at_each_hop(algorithm, errors):
    """At 2 rad/s and h = 0.1 s two periods are 0.4 rad; with extrapolation, nothing."""
    agents = made(algorithm, chain(3), {}, fault=LinkFault(delay=(2, 2)))
    for k in range(1, 401):
        left = agents[0].left(H).position[:, 0] - 2 * k * H
        meet(agents, k, H, target_of(algorithm, 2 * k * H, 2.0))
    np.testing.assert_allclose(left, errors, atol=1e-9)


@dataclass(frozen=True)
class Oscillating(FirstOrder):
    """The target is known to swing with ω = 1: between sampling times an estimate does too."""

    def flow(self, x, dt):
        c, s = np.cos(dt), np.sin(dt)
        return x.replace(
            position=c * x.position + s * x.velocity, velocity=c * x.velocity - s * x.position
        )


def test_a_target_whose_motion_is_known_is_followed_without_error():
    algorithm, h = Oscillating(1.0, 1.0), 0.5
    agents = made(algorithm, chain(3), {})
    for k in range(1, 9):
        left = agents[0].left(h).position[:, 0] - np.sin(k * h)
        meet(agents, k, h, target_of(algorithm, np.sin(k * h), np.cos(k * h)))
    assert np.abs(left).max() < 1e-14


@dataclass(frozen=True)
class Gossip(Algorithm):
    """At each tick one robot wakes, and it and one from which it receives take their mean."""

    STATE: ClassVar = {**Algorithm.STATE, "partner": Field((1,))}
    SENT: ClassVar = {"position": Algorithm.SENT["position"], "partner": Field((1,))}

    robots: int = 5

    def send(self, now, x):
        row, source = now.in_neighbours
        wakes = 1 + np.floor(now.shared().uniform("wake") * self.robots) == now.robots[:, None]
        first = np.searchsorted(row, np.arange(len(now.robots)))[:, None]
        choice = first + np.floor(now.uniform("whom") * now.in_degree).astype(int)
        x = x.replace(partner=np.where(wakes, source[choice], 0.0))
        return x, Values(position=x.position, partner=x.partner), None

    def receive(self, now, x, received):
        mine = received.own(x.partner)[:, 0] == received.source
        theirs = received.samples.partner[:, 0] == now.robots[received.row]
        apart = received.difference("position", x.position)
        step = received.sum(np.where((mine | theirs)[:, None], apart, 0.0)) / 2
        return x.replace(position=x.position + step)


def test_gossip_keeps_the_sum_and_loses_what_it_must_of_the_spread():
    """E‖x − x̄‖² shrinks by 1 − 1/(n − 1) at each tick (Boyd et al. 2006): 0.75⁵ after five."""
    start = np.array([[4.0], [-1.0], [0.0], [7.0], [-10.0]])
    spread = ((start - start.mean()) ** 2).sum()
    left = []
    for seed in range(600):
        parts = [np.array([1, 2]), np.array([3, 4, 5])] if seed % 2 else None
        agents = made(Gossip(), complete(5), {"position": start}, parts, seed=seed)
        for k in range(1, 6):
            meet(agents, k, H, target_of(Gossip()))
        x = whole(agents, "position")
        assert abs(x.sum() - start.sum()) < 1e-12
        left.append(((x - x.mean()) ** 2).sum() / spread)
    error = np.std(left) / np.sqrt(len(left))
    assert abs(np.mean(left) - 0.75**5) < 4 * error
    assert error < 0.02


@dataclass(frozen=True)
class Zoom(Algorithm):
    """Whole numbers on the wire: an encoder each robot, a decoder each link."""

    STATE: ClassVar = {**Algorithm.STATE, "shown": Field()}
    SENT: ClassVar = {"level": Field()}
    LINK: ClassVar = {"decoded": Field()}
    MISSING: ClassVar = ("drop",)

    gain: float = 0.2
    shrink: float = 0.95
    levels: int = 7

    def send(self, now, x):
        step = self.shrink**now.k
        level = np.clip(np.rint((x.position - x.shown) / step), -self.levels, self.levels)
        return x.replace(shown=x.shown + step * level), Values(level=level), None

    def receive(self, now, x, received):
        came = np.where(received.present[:, None], received.samples.level, 0.0)
        decoded = received.links.decoded + self.shrink**now.k * came
        push = self.gain * received.sum(decoded - received.own(x.shown))
        return x.replace(position=x.position + push), Values(decoded=decoded)


def ring(n):
    pairs = {(i, i % n + 1) for i in range(1, n + 1)}
    return schedule(n, [*pairs, *((j, i) for i, j in pairs)])


@pytest.mark.parametrize(("fault", "agrees"), [(None, True), (LinkFault(loss=0.01), False)])
def test_an_encoder_and_its_decoders_agree_as_long_as_nothing_is_lost(fault, agrees):
    """The mean is kept whatever is encoded; one lost level parts a decoder from its encoder."""
    start = np.random.default_rng(3).uniform(-3, 3, (10, 1))
    agents = made(Zoom(), ring(10), {"position": start}, fault=fault)
    for k in range(1, 301):
        meet(agents, k, 1.0, target_of(Zoom()))
    x = whole(agents, "position")
    off = np.abs(x - start.mean()).max()
    if agrees:
        assert abs(x.mean() - start.mean()) < 1e-14
        assert off < 10 * 0.95**300
    else:
        assert off > 0.1


@dataclass(frozen=True)
class Relay(Algorithm):
    """Each robot sends on what it received, side by side."""

    STATE: ClassVar = {
        **Algorithm.STATE,
        "known": Field(("in_degree", "m"), initial=-1e9),
        "second": Field(),
    }
    SENT: ClassVar = {"position": STATE["position"], "known": STATE["known"]}

    def receive(self, now, x, received):  # noqa: ARG002
        width = x.known.shape[1]
        return x.replace(
            known=received.padded(received.samples.position, width, -1e9),
            second=received.maximum(received.samples.known.max(axis=1)),
        )


def test_what_is_sent_on_comes_two_hops():
    """1 → 2 → 3 → 1 and 1 → 3: after two ticks each knows the largest of two hops away."""
    topologies = schedule(3, [(1, 2), (2, 3), (3, 1), (1, 3)])
    agents = made(Relay(), topologies, {"position": [[10.0], [20.0], [30.0]]})
    for k in (1, 2):
        meet(agents, k, H, target_of(Relay()))
    assert whole(agents, "second")[:, 0].tolist() == [20, 30, 30]
