"""Push-sum: the robots' average over a digraph, also where links lose samples.

D. Kempe, A. Dobra, J. Gehrke, Gossip-based computation of aggregate information, FOCS 2003, with
the running sums of C. N. Hadjicostis, N. H. Vaidya, A. D. Dominguez-Garcia, Robust distributed
average consensus via exchange of running sums, IEEE Transactions on Automatic Control 61(6), 2016.
A robot splits its mass s_i and weight w_i into 1 + out-degree equal shares, keeps one, and sends
the sum of all that it ever put out; a receiver takes what that grew by since it last had it:

    s_i⁺ = s_i/(1 + d_i) + Σ_j (σ_j − σ_ij),   w_i likewise;   ε_i⁺ = s_i/w_i,  υ_i⁺ = 0

The ratio comes to the average of the initial s over all robots: what a link loses comes with the
next sample, and one that arrives late or twice does no harm. The target has no share in it.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from nrs_cosim.bus.fields import ESTIMATE, Field, Fields
from nrs_cosim.estimator_agents.algorithm import Algorithm, Missing
from nrs_cosim.estimator_agents.now import Now
from nrs_cosim.estimator_agents.received import Received
from nrs_cosim.estimator_agents.values import Values

SENT: Fields = {
    "sum_s": Field(doc="all mass that was put out for one receiver"),
    "sum_w": Field((1,), doc="all weight that was put out for one receiver"),
}


@dataclass(frozen=True, slots=True)
class PushSum(Algorithm):
    """Average consensus by running sums."""

    STATE: ClassVar[Fields] = {
        **ESTIMATE,
        "s": Field(doc="mass; at first the value of which the average is sought"),
        "w": Field((1,), initial=1.0, doc="weight"),
        **SENT,
    }
    SENT: ClassVar[Fields] = SENT
    LINK: ClassVar[Fields] = {
        "had_s": Field(doc="the running sum of mass that was received last"),
        "had_w": Field((1,), doc="the running sum of weight that was received last"),
    }
    MISSING: ClassVar[tuple[Missing, ...]] = ("hold",)

    def send(self, now: Now, x: Values) -> tuple[Values, Values, None]:
        """Return the state without the shares that go out, and the running sums."""
        share = 1 / (1 + now.out_degree)
        s, w = x.s * share, x.w * share
        after = x.replace(s=s, w=w, sum_s=x.sum_s + s, sum_w=x.sum_w + w)
        return after, Values(sum_s=after.sum_s, sum_w=after.sum_w), None

    def receive(self, now: Now, x: Values, received: Received) -> tuple[Values, Values]:  # noqa: ARG002
        """Return the state with the shares that came, and what was had of each in-neighbour."""
        here, sample, had = received.present[:, None], received.samples, received.links
        sum_s = np.where(here, sample.sum_s, had.had_s)
        sum_w = np.where(here, sample.sum_w, had.had_w)
        s = x.s + received.sum(sum_s - had.had_s)
        w = x.w + received.sum(sum_w - had.had_w)
        position = s / w
        after = x.replace(s=s, w=w, position=position, velocity=np.zeros_like(position))
        return after, Values(had_s=sum_s, had_w=sum_w)
