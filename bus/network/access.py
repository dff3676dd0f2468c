"""With access control, a worker speaks for itself alone, whatever it sends.

A certificate's common name CN is its worker's name. On the session where the workers meet, all is
denied but, from the holder of CN,

    put               nrs/*/samples/CN, nrs/*/records/CN, nrs/*/report/CN
    liveliness token  nrs/*/alive/CN/*
    query             nrs/*/join/CN, nrs/*/start/CN, nrs/*/missed/CN, nrs/*/fmu/*

and what every worker may receive: `nrs/*/samples/*`, `nrs/*/orders/CN`, whether the orchestrator is
there, and the answers to its own queries. So no worker can put the target's samples or an order.
Subscriptions are let through in the other direction: a worker that is not told of them sends
nothing. Zenoh allows a key expression where a rule includes it whole.
"""

from collections.abc import Collection
from typing import Any

from nrs_cosim.bus.errors import InputError
from nrs_cosim.bus.text import quoted

RESERVED = frozenset({"target", "orchestrator"})
_ALL = (
    *("put", "delete", "declare_subscriber", "query", "reply", "declare_queryable"),
    *("liveliness_token", "declare_liveliness_subscriber", "liveliness_query"),
)
_PUTS, _QUERIES = ("samples", "records", "report"), ("join", "start", "missed")
_ORCHESTRATOR = "nrs/*/alive/orchestrator"


def expect_worker_name(name: str, where: str) -> str:
    """Return a worker's name; `InputError` where it cannot stand in a key."""
    wrong = not name or any(sign in "/*$?#@" or not sign.isprintable() for sign in name)
    if wrong or name != name.strip() or name in RESERVED:
        raise InputError(
            f"{where}: expected the name of a worker without / * $ ? # @ that is none of "
            f"{', '.join(sorted(RESERVED))}, got {quoted(name)}"
        )
    return name


def access_control(workers: Collection[str], trusted: Collection[str] = ()) -> dict[str, Any]:
    """Return Zenoh's `access_control` for workers by name; trusted protocols' links may do all."""
    rules, subjects, policies = [], [], []
    for worker in workers:
        expect_worker_name(worker, "bus.tls.workers")
        own = _rules_of(worker)
        rules += own
        subjects.append({"id": f"worker {worker}", "cert_common_names": [worker]})
        policies.append({"rules": [rule["id"] for rule in own], "subjects": [f"worker {worker}"]})
    if trusted:
        rules.append(_rule("trusted", "", _ALL, ["**"], "ingress", "egress"))
        subjects.append({"id": "trusted", "link_protocols": sorted(trusted)})
        policies.append({"rules": ["trusted"], "subjects": ["trusted"]})
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": rules,
        "subjects": subjects,
        "policies": policies,
    }


def _rules_of(worker: str) -> list[dict[str, Any]]:
    receives = ["nrs/*/samples/*", f"nrs/*/orders/{worker}"]
    asks = [*(f"nrs/*/{kind}/{worker}" for kind in _QUERIES), "nrs/*/fmu/*"]
    return [
        _rule(worker, "puts", ["put"], [f"nrs/*/{kind}/{worker}" for kind in _PUTS], "ingress"),
        _rule(worker, "lives", ["liveliness_token"], [f"nrs/*/alive/{worker}/*"], "ingress"),
        _rule(worker, "asks", ["query"], asks, "ingress"),
        _rule(worker, "is answered", ["reply"], asks, "egress"),
        _rule(
            worker,
            "listens",
            ["declare_subscriber"],
            ["nrs/*/samples/*", "nrs/*/orders/*"],
            "ingress",
        ),
        _rule(worker, "receives", ["put"], receives, "egress"),
        _rule(
            worker,
            "watches",
            ["declare_liveliness_subscriber", "liveliness_query"],
            [_ORCHESTRATOR],
            "ingress",
        ),
        _rule(worker, "sees", ["liveliness_token"], [_ORCHESTRATOR], "egress"),
        _rule(worker, "is told", ["declare_subscriber", "declare_queryable"], ["nrs/**"], "egress"),
    ]


def _rule(
    worker: str, does: str, messages: Collection[str], keys: Collection[str], *flows: str
) -> dict[str, Any]:
    return {
        "id": f"{worker} {does}".strip(),
        "messages": list(messages),
        "flows": list(flows),
        "permission": "allow",
        "key_exprs": list(keys),
    }
