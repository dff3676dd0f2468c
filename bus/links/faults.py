"""What is told of faults: a message for each sample that one befell, and each robot in an outage.

It follows from the samples of t_k alone, with no memory of earlier ones: whoever has them can tell.
"""

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.links import Fate, Links
from nrs_cosim.bus.messages import Codec


def told(
    codec: Codec,
    links: Links,
    robots: NDArray[np.integer],
    k: int,
    fate: Fate,
    sent: NDArray[np.float64],
    received: NDArray[np.float64],
) -> NDArray[np.void]:
    """Return records of `FAULT`, by robot and source, on the links into some robots at t_k.

    `sent` and `received` are (F, 2, m); a sample is told of when it is gone, late or altered.
    """
    altered = (received != sent).any(axis=(1, 2))
    of = np.flatnonzero((fate.gone | (fate.delay > 0) | altered) & ~fate.absent)
    silent = np.intersect1d(robots, links.silent(k))
    records = codec.blank(np.concatenate([links.sink[of], silent]))
    records["k"], records["time_ns"] = k, links.ticks.t(k)
    records["source"] = np.concatenate([links.source[of], silent])
    on_links, alone = records[: len(of)], records[len(of) :]
    on_links["lost"], on_links["outage"] = fate.lost[of], fate.outage[of]
    on_links["delay"] = fate.delay[of]
    arriving = np.where(fate.gone[of, None, None], 0, received[of])
    on_links["position"], on_links["velocity"] = arriving[:, 0], arriving[:, 1]
    alone["outage"] = 1
    return records[np.lexsort((records["source"], records["robot"]))]
