"""What a Byzantine robot sends in place of its sample: to all the same, or to some receivers only.

A lie follows from the sample, from the time, and from chance that is keyed by (seed, which lie,
field, sender, receiver, k). It has no memory: whoever tells it, and whenever, it is the same. One
by an algorithm is what that algorithm says at t_k, which is given.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.clock import seconds
from nrs_cosim.bus.links.outages import Spans
from nrs_cosim.bus.random_streams import keyed_normal

Array = NDArray[np.float64]
Pretended = Mapping[int, Mapping[str, Array]]
"""What the algorithms say at t_k by which there are lies: by lie, fields (*shape)."""
LieKind = Literal["stuck", "offset", "ramp", "noise", "algorithm"]
LIE_KINDS: tuple[LieKind, ...] = get_args(LieKind)
NOTHING_PRETENDED: Pretended = {}
_TO_ALL = 0
"""The receiver, in the key of chance, of what is sent to all the same."""


@dataclass(frozen=True, slots=True, eq=False)
class Lie:
    """One lie of one robot."""

    number: int
    """Which of the scenario's, from 0; later ones are told of what earlier ones say."""
    kind: LieKind
    values: Mapping[str, Array]
    """By field, of one number or of the field's shape: where it is stuck, what is added, what is
    added each s since the lie began, or the standard deviation of what is added; none of an
    algorithm."""
    spans: Spans = ()
    """From and to, ns: told at from <= t_k < to; always where there is none."""

    def since(self, t: int) -> int | None:
        """Return when it began, ns, where it is told at a time; else None."""
        spans = self.spans or ((0, t + 1),)
        return next((start for start, end in spans if start <= t < end), None)


class Lies:
    """The lies that are told in some of many rows, a row a robot or a link."""

    def __init__(
        self,
        seed: int,
        by_row: Sequence[Sequence[Lie]],
        source: NDArray[np.integer],
        sink: NDArray[np.integer] | None = None,
    ) -> None:
        """Take the lies of each row, which robot sends, and which one receives them, (rows,)."""
        self._seed = seed
        rows: dict[Lie, list[int]] = {}
        for row, lies in enumerate(by_row):
            for lie in lies:
                rows.setdefault(lie, []).append(row)
        pairs = source.astype(np.int64) << 32 | (_TO_ALL if sink is None else sink)
        self._by_lie = [
            (lie, np.array(rows[lie]), pairs[rows[lie]])
            for lie in sorted(rows, key=lambda lie: lie.number)
        ]

    def sent_instead(
        self, k: int, t: int, sent: Mapping[str, Array], pretended: Pretended = NOTHING_PRETENDED
    ) -> Mapping[str, Array]:
        """Return what is sent at t_k = t, ns, in place of fields (rows, *shape)."""
        instead = dict(sent)
        for lie, rows, pairs in self._by_lie:
            began = lie.since(t)
            if began is None:
                continue
            for name, value in pretended.get(lie.number, lie.values).items():
                if instead[name] is sent[name]:
                    instead[name] = sent[name].copy()
                truth = instead[name][rows]
                if lie.kind in ("stuck", "algorithm"):
                    said = np.broadcast_to(value, truth.shape)
                elif lie.kind == "offset":
                    said = truth + value
                elif lie.kind == "ramp":
                    said = truth + value * seconds(t - began)
                else:
                    purpose, size = f"lie {lie.number} {name}", truth[0].size
                    drawn = keyed_normal(self._seed, purpose, pairs, k, size)
                    said = truth + value * drawn.reshape(truth.shape)
                instead[name][rows] = said
        return instead
