"""First-order DCEA with samples that are sent only when they say something new.

After D. V. Dimarogonas, E. Frazzoli, K. H. Johansson, Distributed event-triggered control for
multi-agent systems, IEEE Transactions on Automatic Control 57(5), 1291-1297, 2012, and
G. S. Seyboth, D. V. Dimarogonas, K. H. Johansson, Event-based broadcasting for multi-agent average
consensus, Automatica 49(1), 245-252, 2013; with samples at t_k, and a model: whoever received ε̂_j,
υ̂_j last, sent at t_s, goes by ε̂_j + (t_k − t_s) υ̂_j, υ̂_j. Robot j knows that too, and sends when
it is off:

    ‖ε_j − ε̂_j − (t_k − t_s) υ̂_j‖∞ > c_0 + c_1 e^{−λ t_k},   or   ‖υ_j − υ̂_j‖∞ > d_0

or when `longest_silence` has gone by, which makes up for what links lose. What others go by is then
off by c_0 and d_0 at most, in steady state: the error's recursion is that of the first-order DCEA
with a bounded input, and x ≤ (I − A)⁻¹ A_N (c_0, d_0) for gains up to 1, where A_N is the part of A
that comes from in-neighbours (statement E1). With c_0 = d_0 = 0 all that changes is sent.

A robot whose estimate jumps by a and b at most, of position and velocity, has moved away from what
it sent q periods ago by q a + h b q (q + 1)/2 and q b at most: it sends again when that has come to
c_0 or d_0, and not before (statement E2).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.bus.fields import ESTIMATE, Field, Fields
from nrs_cosim.bus.mathematics import exponential
from nrs_cosim.estimator_agents.algorithm import Algorithm, Mask, Missing, Spectrum
from nrs_cosim.estimator_agents.condition import Condition
from nrs_cosim.estimator_agents.dcea1 import FirstOrder
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.parameters import parameter
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Array, Values


@dataclass(frozen=True, slots=True)
class EventTriggered(Algorithm):
    """First-order DCEA, event-triggered and model-based."""

    STATE: ClassVar[Fields] = {
        **ESTIMATE,
        "sent_position": Field(doc="where others think that the estimate is"),
        "sent_velocity": Field(doc="the velocity that was sent last"),
        "sent_at": Field((1,), initial=-1.0, unit="s", doc="when that was; -1 for never"),
    }
    MISSING: ClassVar[tuple[Missing, ...]] = ("hold",)
    TRIGGERED: ClassVar[bool] = True

    alpha: float = parameter("gain on the positions", above=0)
    beta: float = parameter("gain on the velocities", above=0)
    c0: float = parameter("how far off a position may be, in the end", unit="rad", least=0)
    d0: float = parameter("how far off a velocity may be", unit="rad/s", least=0)
    c1: float = parameter("how much more a position may be off at t = 0", 0.0, unit="rad", least=0)
    decay: float = parameter("how fast that goes away", 1.0, unit="1/s", above=0)
    longest_silence: float = parameter("after which it is sent anyway", 1e9, unit="s", above=0)

    def flow(self, x: Values, dt: float) -> Values:
        """Return the state a time later; what others go by moves on too."""
        return x.replace(
            position=x.position + dt * x.velocity,
            sent_position=x.sent_position + dt * x.sent_velocity,
        )

    def send(self, now: Now, x: Values) -> tuple[Values, Values, Mask]:
        """Return what was sent last, the messages, and who sends."""
        off = np.abs(x.position - x.sent_position).max(axis=1)
        veer = np.abs(x.velocity - x.sent_velocity).max(axis=1)
        silence = now.t - x.sent_at[:, 0]
        allowed = self.c0 + self.c1 * float(exponential(-self.decay * now.t))
        sends: Mask = (off > allowed) | (veer > self.d0) | (x.sent_at[:, 0] < 0)
        sends |= silence >= self.longest_silence
        column = sends[:, None]
        after = x.replace(
            sent_position=np.where(column, x.position, x.sent_position),
            sent_velocity=np.where(column, x.velocity, x.sent_velocity),
            sent_at=np.where(column, now.t, x.sent_at),
        )
        return after, Values(position=x.position, velocity=x.velocity), sends

    def receive(self, now: Now, x: Values, received: Received) -> Values:
        """Return the state right after t_k."""
        elapsed = (received.age * now.h)[:, None]
        sample = received.samples
        apart = sample.position + elapsed * sample.velocity - received.own(x.position)
        return x.replace(
            position=x.position + self.alpha * received.mean(apart),
            velocity=x.velocity + self.beta * received.disagreement("velocity", x.velocity),
        )

    def modes(self, spectrum: Spectrum, h: float) -> Spectrum:
        """Return those of the first-order DCEA, of the recursion that the trigger disturbs."""
        return FirstOrder(self.alpha, self.beta).modes(spectrum, h)

    def nominal(self) -> tuple[Algorithm, Mapping[str, float]]:
        """Return the first-order DCEA, and how far off others' models of an estimate may be."""
        off = {"position": self.c0 + self.c1, "velocity": self.d0}
        return FirstOrder(self.alpha, self.beta), off

    def periods_between(self, position: Array, velocity: Array, h: float) -> Array:
        """Return the least q at which q a + h b q (q + 1)/2 ≥ c_0 or q b ≥ d_0, or silence ends."""
        with np.errstate(divide="ignore", invalid="ignore"):
            half = position / h + velocity / 2
            root = np.sqrt(half**2 + 2 * velocity * self.c0 / h)
            of_position = 2 * self.c0 / h / (half + root)
            of_velocity = self.d0 / velocity
        silence = self.longest_silence / h
        least = np.fmin(np.fmin(of_position, of_velocity), silence)
        # A bound from below: what is a whole number but for rounding counts as that one.
        periods: Array = np.maximum(np.ceil(least * (1 - 1e-12)), 1)
        return periods

    def conditions(self, spectrum: Spectrum, h: float) -> list[Condition]:
        """Return Theorem 1's bound on both gains."""
        return FirstOrder(self.alpha, self.beta).conditions(spectrum, h)
