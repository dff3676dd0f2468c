"""What a topic of one node says by its name; the oracle of tests."""


def node_of(topic: str) -> int:
    """Return whose a topic is: the number of a robot, or 0, the target."""
    folder = topic.split("/")[1]
    return 0 if folder == "target" else int(folder.removeprefix("robot_"))
