"""The network as a picture: who receives from whom.

Of few robots it is a digraph: the target in the middle, the robots on a circle, an arrow a link
from who sends to who receives, bent to its left, so that there are two where both receive; it is as
wide as its weight. Of many it is a matrix: row i has a mark in column j where robot i receives from
robot j, of which 0 is the target. Only inline SVG is written: the page's style sheet colours it, by
class, and its script shows the links of a phase by `data-phases`.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from nrs_cosim.bus.topologies import edges_among
from nrs_cosim.recordings.link_counts import KINDS
from nrs_cosim.recordings.report.data import Story

Array = NDArray[np.float64]
SIZE, RADIUS = 460.0, 180.0
MOST_CIRCLED = 40
"""Robots on a circle."""
MOST_LINKS = 30_000
_BEND = 0.16
_MARGIN = 34.0
"""Of a matrix, for its numbers."""


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
    if topology.n > MOST_CIRCLED:
        about = "Row i has a mark in column j where robot i receives from robot j; 0 is the target."
        return f'{_svg("".join(_matrix(story)))}<p class="about">{about}</p>{phases}'
    nodes = places(topology.n)
    node = float(np.clip(RADIUS * np.pi / max(topology.n, 1) * 0.62, 5, 22))
    body = [*_links(story, nodes, node), *_nodes(story, nodes, node)]
    about = (
        "An arrow goes from who sends to who receives, as wide as its weight. Robots with a thick "
        "ring receive from the target ε<sub>0</sub>."
    )
    return f'{_svg("".join(body), node / 3.2)}<p class="about">{about}</p>{phases}'


def turns(story: Story) -> dict[str, list[float]]:
    """Return when phases begin, s, and which they are; nothing where there is one alone."""
    topologies = story.subject.topologies
    if topologies.is_constant:
        return {}
    t, which = [0.0], [topologies.at(1)]
    for k in range(2, story.ticks + 1):
        if (phase := topologies.at(k)) != which[-1]:
            t.append(float(story.t_k[k - 1]))
            which.append(phase)
    return {"t": t, "which": [float(phase) for phase in which]}


def _svg(body: str, ring: float = 0.0) -> str:
    return (
        f'<svg viewBox="0 0 {SIZE:g} {SIZE:g}" style="--ring: {ring:.2g}px" role="img" '
        f'aria-label="Who receives from whom">{body}</svg>'
    )


def _phases(story: Story) -> Sequence[str]:
    """Return of each link the phases that have it, as text; empty where it is always there."""
    topologies = story.subject.topologies
    links = topologies.links
    if topologies.is_constant:
        return [""] * len(links.weight)
    there = np.zeros((len(topologies.exchanges), len(links.weight)), bool)
    for phase, exchange in enumerate(topologies.exchanges):
        for digraph in (exchange.position, exchange.velocity):
            there[phase] |= edges_among(digraph, links.source, links.sink) >= 0
    return [" ".join(map(str, np.flatnonzero(column))) for column in there.T]


def _attribute(phases: str) -> str:
    return f' data-phases="{phases}"' if phases else ""


def _matrix(story: Story) -> Iterator[str]:
    """Yield marks a set of phases, in one path each, the frame and the numbers."""
    links = story.subject.topology
    cell = (SIZE - _MARGIN - 16) / (links.n + 1)
    side = max(cell, 1.6)
    yield (
        f'<rect class="frame" x="{_MARGIN:g}" y="{_MARGIN:g}" width="{_n(cell * (links.n + 1))}" '
        f'height="{_n(cell * links.n)}"/>'
    )
    marks: dict[tuple[str, str], list[str]] = defaultdict(list)
    for phases, j, i in zip(
        _phases(story), links.source.tolist(), links.sink.tolist(), strict=True
    ):
        kind = "link pinning" if j == 0 else "link"
        x, y = _MARGIN + j * cell, _MARGIN + (i - 1) * cell
        marks[kind, phases].append(f"M{x:.2f} {y:.2f}h{side:.3g}v{side:.3g}h-{side:.3g}z")
    for (kind, phases), squares in marks.items():
        yield f'<g class="{kind} mark"{_attribute(phases)}><path d="{"".join(squares)}"/></g>'
    step = next(s * 10**e for e in range(9) for s in (1, 2, 5) if s * 10**e * 5 >= links.n)
    for number in range(0, links.n + 1, step):
        along = _n(_MARGIN + (number + 0.5) * cell)
        yield f'<text class="number" x="{along}" y="{_MARGIN / 2:g}">{number}</text>'
        if number:
            along = _n(_MARGIN + (number - 0.5) * cell)
            yield f'<text class="number" x="{_MARGIN / 2:g}" y="{along}">{number}</text>'


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
    for j, i, weight, phases in zip(
        topology.source.tolist(),
        topology.sink.tolist(),
        topology.weight.tolist(),
        _phases(story),
        strict=True,
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
            f'<g class="{kind}" data-nodes="{j} {i}"{_attribute(phases)}>'
            f"<title>{'; '.join(lines)}</title>"
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
