"""The paper's example and its matrices Λ, Γ, written out densely: the oracle of these tests."""

import numpy as np

from nrs_cosim.estimator_agents.target import Harmonic
from tests.bus.test_topology import PAPER

ADJACENCY, PINNING = (np.array(part, float) for part in PAPER)
D = ADJACENCY / (ADJACENCY.sum(axis=1) + PINNING)[:, None]
ONE = np.eye(6)


def first_order(alpha: float, beta: float, h: float, d: np.ndarray = D) -> np.ndarray:
    """Return Λ for m = 1 (paper, after equation 2.3)."""
    P = (1 - beta) * ONE + beta * d
    return np.block([[(1 - alpha) * ONE + alpha * d, h * P], [0 * ONE, P]])


def second_order(alpha: float, beta: float, h: float, d: np.ndarray = D) -> np.ndarray:
    """Return Γ for m = 1 (paper, after equation 2.0)."""
    P = (1 - beta) * ONE + beta * d
    return np.block([[(1 - alpha * h) * ONE + alpha * h * d, h * P], [-alpha * (ONE - d), P]])


def target(t: float) -> np.ndarray:
    """Return ε_0(t), υ_0(t) of the example: (2, m)."""
    return np.array([[2 * t + np.sin(t), -2 * t - np.cos(t)], [2 + np.cos(t), -2 + np.sin(t)]])


HARMONIC = Harmonic(
    np.zeros(2),
    np.array([2.0, -2.0]),
    np.array([[1.0], [-1.0]]),
    np.ones((2, 1)),
    np.array([[0.0], [np.pi / 2]]),
)


def recursion(matrix: np.ndarray, x1: np.ndarray, h: float, ticks: int) -> list[np.ndarray]:
    """Return x(t_k) for k = 1 … ticks: errors of positions then velocities, (2 n, m)."""
    x, story = x1, [x1]
    for k in range(1, ticks):
        (now, v_now), (then, v_then) = target(k * h), target((k + 1) * h)
        delta = np.concatenate(
            [np.tile(now - then + h * v_now, (6, 1)), np.tile(v_now - v_then, (6, 1))]
        )
        x = matrix @ x + delta
        story.append(x)
    return story
