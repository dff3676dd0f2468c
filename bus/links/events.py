"""Link events: a message for each sample that a link lost, delayed, duplicated or altered, and
each outage.

It follows from the samples of t_k alone, with no memory of earlier ones: whoever has them can tell.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.links.links import LinkOutcome, Links

Array = NDArray[np.float64]
Sent = Mapping[str, Array]
"""Fields of samples by name, (F, …) each."""


def link_events(
    links: Links,
    robots: NDArray[np.integer],
    k: int,
    outcome: LinkOutcome,
    sent: Sent,
    received: Sent,
    fresh: NDArray[np.bool_] | None = None,
) -> NDArray[np.void]:
    """Return records of the run's link events, by robot and source, on links into robots at t_k.

    A sample has one when it is gone, late, duplicated or altered. `fresh` says on which links there
    is a sample of t_k, (F,): on all unless given.
    """
    altered = np.zeros(len(links.sink), bool)
    for name, values in sent.items():
        altered |= (received[name] != values).any(axis=tuple(range(1, values.ndim)))
    there = ~outcome.absent if fresh is None else fresh & ~outcome.absent
    changed = outcome.gone | (outcome.delay > 0) | (outcome.duplicates > 0) | altered
    of = np.flatnonzero(changed & there)
    silent = np.intersect1d(robots, links.silent(k))
    records = links.codec.blank(np.concatenate([links.sink[of], silent]))
    records["k"], records["time_ns"] = k, links.ticks.t(k)
    records["source"] = np.concatenate([links.source[of], silent])
    on_links, alone = records[: len(of)], records[len(of) :]
    on_links["lost"], on_links["outage"] = outcome.lost[of], outcome.outage[of]
    on_links["delay"] = outcome.delay[of]
    if "duplicates" in links.codec.kind.counts:
        on_links["duplicates"] = outcome.duplicates[of]
    arrives = of[~outcome.gone[of]]
    for name, values in received.items():
        on_links[name][~outcome.gone[of]] = values[arrives]
    alone["outage"] = 1
    return records[np.lexsort((records["source"], records["robot"]))]
