"""Link events: a message for each sample that a link lost, delayed or altered, and each outage.

It follows from the samples of t_k alone, with no memory of earlier ones: whoever has them can tell.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.links import LinkOutcome, Links
from nrs_cosim.bus.messages import Codec


def link_events(
    codec: Codec,
    links: Links,
    robots: NDArray[np.integer],
    k: int,
    outcome: LinkOutcome,
    sent: NDArray[np.float64],
    received: NDArray[np.float64],
) -> NDArray[np.void]:
    """Return records of `LINK_EVENT`, by robot and source, on the links into some robots at t_k.

    `sent` and `received` are (F, 2, m); a sample has one when it is gone, late or altered.
    """
    altered = (received != sent).any(axis=(1, 2))
    of = np.flatnonzero((outcome.gone | (outcome.delay > 0) | altered) & ~outcome.absent)
    silent = np.intersect1d(robots, links.silent(k))
    records = codec.blank(np.concatenate([links.sink[of], silent]))
    records["k"], records["time_ns"] = k, links.ticks.t(k)
    records["source"] = np.concatenate([links.source[of], silent])
    on_links, alone = records[: len(of)], records[len(of) :]
    on_links["lost"], on_links["outage"] = outcome.lost[of], outcome.outage[of]
    on_links["delay"] = outcome.delay[of]
    arriving = np.where(outcome.gone[of, None, None], 0, received[of])
    on_links["position"], on_links["velocity"] = arriving[:, 0], arriving[:, 1]
    alone["outage"] = 1
    return records[np.lexsort((records["source"], records["robot"]))]
