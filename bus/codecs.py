"""The message types of one run follow from what its algorithm declares that it sends and keeps.

An algorithm that sends exactly a position and a velocity, each of m numbers, has the standing types
`nrs.Sample` and `nrs.LinkEvent`; any other has types of its own, `nrs.<Class>.Sample` and so on.
What it keeps beside these two is the agent's state, and has a message type where there is any; so
has what its robots measure of the target, where it says how: `nrs.Measurement` or one of its own.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from nrs_cosim.bus.fields import ESTIMATE, Field, Fields, Sizes
from nrs_cosim.bus.messages import (
    LINK_EVENT,
    MEASUREMENT,
    SAMPLE,
    STATE,
    Codec,
    Count,
    MessageType,
)

DUPLICATES = {"duplicates": Count("how many more copies of the sample arrive with it")}
"""What link events also have where links may duplicate samples."""


@dataclass(frozen=True, slots=True, eq=False)
class Codecs:
    """What codes the messages of a run."""

    samples: Codec
    states: Codec
    link_events: Codec
    of_agents: Mapping[str, Codec]
    """Of what agents tell of themselves at t_k, by kind: `agent_state`, where they keep more than ε
    and υ, and `measurement`, where their algorithm says what they measure."""

    @classmethod
    def of(
        cls,
        sizes: Sizes,
        owner: str = "",
        sent: Fields = ESTIMATE,
        kept: Fields = ESTIMATE,
        *,
        measured: bool = False,
        duplicates: bool = False,
    ) -> "Codecs":
        """Return those for an algorithm's class by its name, and the fields that it declares.

        `measured` says whether it has a measurement of its own, `duplicates` whether links may
        duplicate samples.
        """
        owner = re.sub(r"\W", "_", owner, flags=re.ASCII)
        further = {name: field for name, field in kept.items() if name not in ESTIMATE}
        of_agents = {}
        if further:
            of_agents["agent_state"] = MessageType(f"nrs.{owner}.AgentState", _documented(further))
        if measured:
            of_agents["measurement"] = _measurement(owner, sent)
        return cls(
            Codec(_sample(owner, sent), sizes),
            Codec(STATE, sizes),
            Codec(_link_event(owner, sent, duplicates), sizes),
            {kind: Codec(message, sizes) for kind, message in of_agents.items()},
        )

    @property
    def types(self) -> tuple[MessageType, ...]:
        """What message types they code."""
        found = (self.samples, self.states, self.link_events, *self.of_agents.values())
        return tuple(codec.kind for codec in found)


def _is_estimate(fields: Fields) -> bool:
    # In this order too, which is that of the numbers in a message.
    shapes, standing = (
        [(name, field.shape) for name, field in of.items()] for of in (fields, ESTIMATE)
    )
    return shapes == standing


def _sample(owner: str, sent: Fields) -> MessageType:
    return SAMPLE if _is_estimate(sent) else MessageType(f"nrs.{owner}.Sample", _documented(sent))


def _link_event(owner: str, sent: Fields, duplicates: bool) -> MessageType:
    further: Mapping[str, Field | Count] = DUPLICATES if duplicates else {}
    if _is_estimate(sent):
        return replace(LINK_EVENT, entries={**LINK_EVENT.entries, **further})
    counts = {name: LINK_EVENT.entries[name] for name in LINK_EVENT.counts}
    arrives = "what arrives, zeros when nothing does"
    fields = {
        name: replace(field, truth=None, doc=f"{field.doc}; {arrives}" if field.doc else arrives)
        for name, field in sent.items()
    }
    return MessageType(f"nrs.{owner}.LinkEvent", {**counts, **further, **fields})


def _measurement(owner: str, sent: Fields) -> MessageType:
    if _is_estimate(sent):
        return MEASUREMENT
    fields = {
        name: replace(field, doc=f"measured of the target: {field.doc or name}")
        for name, field in sent.items()
    }
    return MessageType(f"nrs.{owner}.Measurement", fields)


def _documented(fields: Fields) -> dict[str, Field]:
    return {name: replace(field, doc=field.doc or name) for name, field in fields.items()}
