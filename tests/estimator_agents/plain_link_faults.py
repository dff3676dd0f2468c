"""A network with faults in plain Python, a link and a number at a time: the oracle of its tests.

It shares the keys of the draws with the project, and nothing else: it keeps the whole story of a
link, every sample with its arrival, and looks through all of it at each sampling time.
"""

from dataclasses import dataclass, field
from zlib import crc32

import numpy as np

from nrs_cosim.bus.random_streams import normal

BLOCK = 64


@dataclass
class Network:
    """w[i][j] of robot i + 1 and node j; `links` as keys of a scenario's entry, by (j, i).

    `turns` are [from tick, w of positions, w of velocities] in place of w from then on.
    """

    w: list[list[float]]
    links: dict[tuple[int, int], dict] = field(default_factory=dict)
    robots: dict[int, list[tuple[int, int]]] = field(default_factory=dict)
    gaps: tuple[int, ...] = (10,)
    seed: int = 0
    m: int = 2
    missing: str = "hold"
    turns: list[tuple[int, list[list[float]], list[list[float]]]] = field(default_factory=list)
    repeat: int | None = None

    def weights(self, k):
        """Return w at t_k, of positions and of velocities."""
        if self.repeat:
            k = (k - 1) % self.repeat + 1
        now = (self.w, self.w)
        for since, *both in self.turns:
            if since <= k:
                now = both
        return now

    def has(self, j, i, k):
        return any(w[i - 1][j] for w in self.weights(k))

    def pairs(self):
        """Return all (j, i) between which there is a link at some time."""
        every = [self.w, *(w for _, *both in self.turns for w in both)]
        n = len(self.w)
        return [
            (j, i) for i in range(1, n + 1) for j in range(n + 1) if any(w[i - 1][j] for w in every)
        ]

    def block(self, purpose, j, i, k):
        key = np.random.SeedSequence([self.seed, crc32(purpose.encode()), j, i, k // BLOCK])
        return np.random.Generator(np.random.Philox(key))

    def t(self, k):
        """Return t_k: the gaps, over and over."""
        return sum(self.gaps[i % len(self.gaps)] for i in range(k))

    def silent(self, node, k):
        t = self.t(k)
        return any(a <= t < b for a, b in self.robots.get(node, []))

    def way(self, j, i, k, sent):
        """Return what becomes of one sample: lost, outage, delay, and the numbers that arrive."""
        fault = self.links.get((j, i), {})
        lost = outage = False
        delay = 0
        if "loss" in fault:
            lost = self.block("link loss", j, i, k).random(BLOCK)[k % BLOCK] < fault["loss"]
        if "delay" in fault:
            low, high = fault["delay"]
            delay = low
            if low < high:
                rng = self.block("link delay", j, i, k)
                delay = int(rng.integers(low, high, BLOCK, endpoint=True)[k % BLOCK])
        outage = any(a <= self.t(k) < b for a, b in fault.get("outages", []))
        outage = outage or self.silent(j, k) or self.silent(i, k) or self.silent(i, k + delay)
        if lost or outage:
            return bool(lost), outage, delay, [[0.0] * self.m] * 2
        noise = None
        if "noise" in fault:
            rng = self.block("link noise", j, i, k)
            noise = normal(rng, (BLOCK, 2, self.m))[k % BLOCK].tolist()
        arriving = []
        for part in range(2):
            row = list(sent[part])
            if noise:
                row = [x + fault["noise"][part] * z for x, z in zip(row, noise[part], strict=True)]
            step = fault.get("quantisation", (0, 0))[part]
            if step:
                row = [round(x / step) * step for x in row]
            arriving.append(row)
        return False, False, delay, arriving


def simulate(network, jump, start, targets, h, ticks):
    """Return, for each tick, the left limits, the estimates after it, and the faults told.

    Estimates are [position, velocity] of lists of m numbers, by robot; `targets` those of node 0 by
    tick; `jump` gives a robot's estimate from its left limits and the two disagreements.
    """
    n = len(network.w)
    now = {i: [list(part) for part in start[i]] for i in range(1, n + 1)}
    on_way = {link: [] for link in network.pairs()}
    last = dict.fromkeys(on_way)
    story = []
    for k in range(1, ticks + 1):
        left = {i: [[x + h * v for x, v in zip(*now[i], strict=True)], now[i][1]] for i in now}
        sent = {0: targets[k], **left}
        zeros = [0.0] * network.m
        result = [(i, i, 0, 1, 0, zeros, zeros) for i in now if network.silent(i, k)]
        there = {}
        for (j, i), samples in on_way.items():
            if network.has(j, i, k):
                lost, outage, delay, arriving = network.way(j, i, k, sent[j])
                if not (lost or outage):
                    samples.append((k + delay, k, arriving))
                if lost or outage or delay or arriving != sent[j]:
                    result.append((i, j, int(lost), int(outage), delay, *arriving))
            newest = max((s for s in samples if s[0] == k), key=lambda s: s[1], default=None)
            delivered = newest and (last[j, i] is None or newest[1] > last[j, i][1])
            if delivered:
                last[j, i] = newest
            if network.missing == "drop":
                there[j, i] = newest[2] if delivered else None
            else:
                there[j, i] = last[j, i] and last[j, i][2]
        weights = network.weights(k)
        now = {i: jump(left[i], *_disagreement(weights, i, left[i], there)) for i in now}
        story.append((left, now, sorted(result)))
    return story


def _disagreement(weights, i, own, there):
    """Sum in the order in which NumPy's reduceat does: the first, plus the sum of the rest."""
    return [
        _sums(w[i - 1], own[part], {j: x and x[part] for (j, to), x in there.items() if to == i})
        for part, w in enumerate(weights)
    ]


def _sums(row, own, there):
    degree = 0.0
    for weight in row:
        degree += weight
    terms = [(weight / degree, there[j]) for j, weight in enumerate(row) if weight]
    rest = 1.0
    if any(x is None for _, x in terms) and any(x is not None for _, x in terms):
        rest = _total([0.0 if x is None else weight for weight, x in terms])
    return [
        _total([0.0 if x is None else weight * (x[a] - own[a]) for weight, x in terms]) / rest
        for a in range(len(own))
    ]


def _total(terms):
    first, *others = terms
    if not others:
        return first
    rest = others[0]
    for term in others[1:]:
        rest += term
    return first + rest
