"""The network as a picture: the target in the middle, the robots on a circle, an arrow a link.

An arrow goes from who sends to who receives, bent to its left, so that there are two
where both receive; it is as wide as its weight. Only inline SVG is written: the page's style sheet
colours it, by class.
"""

from collections import Counter
from collections.abc import Iterator
from html import escape

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.recordings.report.data import KINDS, Story

Array = NDArray[np.float64]
SIZE, RADIUS = 460.0, 180.0
MOST_LINKS = 1500
_BEND = 0.16


def places(n: int) -> Array:
    """Return where the nodes 0 … n stand, (n + 1, 2), in a square of side `SIZE`."""
    angle = 2 * np.pi * (np.arange(n) / max(n, 1)) - np.pi / 2
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1) * RADIUS
    return np.vstack([np.zeros((1, 2)), circle]) + SIZE / 2


def drawn(story: Story) -> str:
    """Return the picture of a story's network, or in words that it is too large for one."""
    topology = story.subject.topology
    phases = f'<p class="about">{escape(story.subject.phases)}</p>' if story.subject.phases else ""
    if len(topology.weight) > MOST_LINKS:
        links = f"{topology.n} robots and {len(topology.weight)} links"
        return f"<p>{links}: too many to draw.</p>{phases}"
    nodes = places(topology.n)
    node = float(np.clip(RADIUS * np.pi / max(topology.n, 1) * 0.62, 5, 22))
    body = [*_links(story, nodes, node), *_nodes(story, nodes, node)]
    return (
        f'<svg viewBox="0 0 {SIZE:g} {SIZE:g}" style="--ring: {node / 3.2:.2g}px" role="img" '
        f'aria-label="Who receives from whom">{"".join(body)}</svg>{phases}'
    )


def _links(story: Story, nodes: Array, node: float) -> Iterator[str]:
    topology = story.subject.topology
    events = story.link_events
    met = Counter(
        zip(
            events.source.tolist(),
            events.robot.tolist(),
            events.kind.tolist(),
            strict=True,
        )
    )
    widest = float(topology.weight.max(initial=1.0))
    for j, i, weight in zip(
        topology.source.tolist(), topology.sink.tolist(), topology.weight.tolist(), strict=True
    ):
        start, end = nodes[j], nodes[i]
        along = end - start
        bend = 0.0 if j == 0 else _BEND
        control = (start + end) / 2 + bend * np.array([along[1], -along[0]])
        start = start + _unit(control - start) * (node + 2)
        tip = end + _unit(control - end) * (node + 2)
        into = _unit(tip - control)
        aside = np.array([-into[1], into[0]])
        width = 1.0 + 2.0 * weight / widest
        head = 5.0 + 1.6 * width
        base = tip - into * head
        wings = [base + aside * head * 0.45, base - aside * head * 0.45]
        kind = "link pinning" if j == 0 else "link"
        sender = f"robot {j}" if j else "the target"
        lines = [f"robot {i} receives from {sender}, weight {weight:g}"]
        lines += [f"{met[j, i, at]} {name}" for at, name in enumerate(KINDS) if met[j, i, at]]
        middle = (start + 2 * control + tip) / 4
        label = (
            ""
            if weight == 1 or node < 12
            else f'<text x="{_n(middle[0])}" y="{_n(middle[1])}">{weight:g}</text>'
        )
        points = " ".join(f"{_n(x)},{_n(y)}" for x, y in (tip, *wings))
        yield (
            f'<g class="{kind}" data-nodes="{j} {i}"><title>{"; ".join(lines)}</title>'
            f'<path d="M{_n(start[0])} {_n(start[1])}Q{_n(control[0])} {_n(control[1])} '
            f'{_n(base[0])} {_n(base[1])}" stroke-width="{width:.2g}"/>'
            f'<polygon points="{points}"/>{label}</g>'
        )


def _nodes(story: Story, nodes: Array, node: float) -> Iterator[str]:
    topology = story.subject.topology
    pinned = set(topology.pinned.tolist())
    for number, (x, y) in enumerate(nodes):
        if number == 0:
            kind, name, label = "node target", "the target", "ε₀"
        else:
            kind = "node pinned" if number in pinned else "node"
            name, label = f"robot {number}", str(number)
            name += ": it receives from the target" if number in pinned else ""
        text = f'<text x="{_n(x)}" y="{_n(y)}">{label}</text>' if node > 8 else ""
        yield (
            f'<g class="{kind}" data-robot="{number}"><title>{name}</title>'
            f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(node)}"/>{text}</g>'
        )


def _unit(vector: Array) -> Array:
    return vector / max(float(np.hypot(*vector)), 1e-9)


def _n(value: float) -> str:
    return f"{value:.1f}"
