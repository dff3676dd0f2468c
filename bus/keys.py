"""A node's messages have topics of their own; what a worker puts at one tick travels as one batch.

In a recording node 0 is the target and the robots are 1 … n: `/target/sample`, `/robot_1/sample`,
`/robot_1/state`, `/robot_1/agent_state`, `/robot_1/measurement`, `/robot_1/link_event`,
`/robot_1/checkpoint`, so that a robot is one folder in every viewer's tree, with a name that ROS
allows; of many robots some share topics (`bus.topics`). On the wire a key is `<kind>/<worker>`.
"""

TARGET, ORCHESTRATOR, EVERYONE = "target", "orchestrator", "*"
"""Who puts the target's samples; who is present for the run as a whole; all of them."""
SAMPLES, RECORDS, REPORT, ORDERS = "samples", "records", "report", "orders"
"""What workers put: for one another, for the recorder, for the orchestrator; what they are told."""
JOIN, START, MISSED, FMU = "join", "start", "missed", "fmu"
"""What workers ask for: to be let in; to begin; samples they missed; an FMU by its SHA-256."""
ALIVE = "alive"


def topic_of(kind: str, node: int) -> str:
    """Return the topic of a kind of a node's messages.

    `sample`: its estimates (of node 0, the target's own) at the sampling times; `state`: on the
    output grid; `link_event`: what the links into it did to samples; `agent_state`: what its agent
    keeps beside its estimate, right after t_k; `measurement`: what it measures of the target at
    t_k, when it is pinned; `checkpoint`: from what it can be restored.
    """
    return f"/{node_name(node)}/{kind}"


def node_name(node: int) -> str:
    """Return what a robot, or node 0, the target, is called in topics and frames."""
    return f"robot_{node}" if node else TARGET


def kind_of(topic: str) -> str:
    """Return what the messages of a topic are: sample, state, link_event and so on."""
    return topic.rpartition("/")[2]


def wire_key(kind: str, name: str) -> str:
    """Return the key of one kind of a worker's messages."""
    return f"{kind}/{name}"
