"""A node's messages travel on keys of its own: `sample/<node>` and `state/<robot>`.

What befell the samples on their way to a robot is told on `fault/<robot>`. Node 0 is the
target; the robots are 1 … n. A key is also the topic of its messages in a recording.
"""

SAMPLES = "sample/*"
EVERYTHING = "*/*"


def sample_key(node: int) -> str:
    """Return the key of a node's estimates (for node 0: of the target) at the sampling times."""
    return f"sample/{node}"


def state_key(robot: int) -> str:
    """Return the key of a robot's state on the output grid."""
    return f"state/{robot}"


def fault_key(robot: int) -> str:
    """Return the key of what befell the samples that were on their way to a robot."""
    return f"fault/{robot}"
