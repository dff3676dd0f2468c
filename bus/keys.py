"""A node's messages have topics of their own; what a host puts at one tick travels as one batch.

In a recording node 0 is the target and the robots are 1 … n: `sample/<node>`, `state/<robot>`,
`fault/<robot>`, `checkpoint/<robot>`. On the wire a key is `<kind>/<host>`.
"""

TARGET, ORCHESTRATOR, EVERYONE = "target", "orchestrator", "*"
"""Who puts the target's samples; who is present for the run as a whole; all of them."""
SAMPLES, RECORDS, REPORT, ORDERS = "samples", "records", "report", "orders"
"""What hosts put: for one another, for the recorder, for the orchestrator; what they are told."""
JOIN, START, HEARD, FMU = "join", "start", "heard", "fmu"
"""What hosts ask for: to be let in; to begin; samples they missed; an FMU by its SHA-256."""
ALIVE = "alive"


def sample_key(node: int) -> str:
    """Return the topic of a node's estimates (for node 0: of the target) at the sampling times."""
    return f"sample/{node}"


def state_key(robot: int) -> str:
    """Return the topic of a robot's state on the output grid."""
    return f"state/{robot}"


def fault_key(robot: int) -> str:
    """Return the topic of the link faults that a robot met."""
    return f"fault/{robot}"


def checkpoint_key(robot: int) -> str:
    """Return the topic of what a robot can be restored from."""
    return f"checkpoint/{robot}"


def wire_key(kind: str, name: str) -> str:
    """Return the key of one kind of a host's messages."""
    return f"{kind}/{name}"
