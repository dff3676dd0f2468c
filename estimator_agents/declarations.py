"""What is wrong with the declarations of a class of algorithms, each in words that name it."""

from collections.abc import Iterator, Mapping
from itertools import chain
from typing import Any, get_args

from nrs_cosim.bus.fields import ESTIMATE, wrong_fields
from nrs_cosim.estimator_agents.algorithm import POLICIES, Algorithm, Arrivals, overrides
from nrs_cosim.estimator_agents.values import Values

DECLARED = ("STATE", "SENT", "LINK", "MISSING", "ARRIVALS", "TRIGGERED", "SEPARATE_GRAPHS")
"""What a class of algorithms declares beside its methods."""


def wrong_declarations(kind: type[Algorithm]) -> list[str]:
    """Return what is wrong with a class; nothing where all is well."""
    wrong = list(_wrong_fields(kind))
    return wrong or list(chain(_wrong_rules(kind), _wrong_methods(kind)))


def _wrong_fields(kind: type[Algorithm]) -> Iterator[str]:
    for name in ("STATE", "SENT", "LINK"):
        declared: Any = getattr(kind, name)
        if not isinstance(declared, Mapping):
            yield f"{name}: expected a mapping of names to fields, got {declared!r}"
            continue
        yield from (f"{name}: {what}" for what in wrong_fields(declared))
        for field in map(str, declared):
            if hasattr(Values, field):
                yield f"{name}: {field}: is a method of all values; give another name"
    for field, standing in ESTIMATE.items():
        if field not in kind.STATE or kind.STATE[field].shape != standing.shape:
            shape = standing.shape
            yield f"STATE: {field}: expected a field of shape {shape}, which the robot follows"
    for name, sent in kind.SENT.items():
        if sent.truth and sent.shape != ("m",):
            yield f"SENT: {name}: expected the shape ('m',) of the target's {sent.truth}"
    if not kind.SENT:
        yield "SENT: expected one field at least"


def _wrong_rules(kind: type[Algorithm]) -> Iterator[str]:
    policies: Any = kind.MISSING
    if not isinstance(policies, tuple) or not policies or not set(policies) <= set(POLICIES):
        yield f"MISSING: expected a tuple of some of {', '.join(POLICIES)}, got {policies!r}"
    if kind.ARRIVALS not in get_args(Arrivals):
        yield f"ARRIVALS: expected one of {', '.join(get_args(Arrivals))}, got {kind.ARRIVALS!r}"
    elif kind.ARRIVALS == "every" and policies != ("drop",):
        yield 'MISSING: expected ("drop",): with ARRIVALS "every" a sample is received once'
    elif kind.ARRIVALS == "every" and overrides(kind, "observe"):
        yield 'ARRIVALS: expected "newest": a look at the target is the newest that there is'
    for name in ("TRIGGERED", "SEPARATE_GRAPHS"):
        value: Any = getattr(kind, name)
        if not isinstance(value, bool):
            yield f"{name}: expected True or False, got {value!r}"
    if kind.SEPARATE_GRAPHS and (kind.LINK or kind.ARRIVALS == "every"):
        yield "SEPARATE_GRAPHS: expected False, for LINK and ARRIVALS are of one digraph"


def _wrong_methods(kind: type[Algorithm]) -> Iterator[str]:
    sends, receives = overrides(kind, "send"), overrides(kind, "receive")
    if kind.TRIGGERED and not sends:
        yield "TRIGGERED: expected a method send, which returns who sends"
    unknown = [field for field in kind.SENT if field not in kind.STATE]
    if unknown and not sends:
        yield f"SENT: {unknown[0]}: is no field of STATE; name one, or add a method send"
    if not receives and not overrides(kind, "jump"):
        yield "jump: expected a method jump or receive"
    if not receives and not set(ESTIMATE) <= set(kind.SENT):
        yield "SENT: expected position and velocity, which jump needs; or a method receive"
