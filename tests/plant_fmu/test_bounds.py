"""P3 of the bundled models against fine grids of matrices written by other means."""

import numpy as np
import pytest
from scipy.optimize import minimize_scalar

from nrs_cosim.plant_fmu.bundled.bounds import Bounds, arm, bounds_of


def two_link(q, eta):
    """Return M, C(η, q), G of the paper's arm, as its example has them."""
    r1, r2, J1, J2, m1, m2, g = 1.0, 0.8, 5.0, 5.0, 0.5, 1.5, 9.8
    c2, b = np.cos(q[1]), m2 * r1 * r2 * np.sin(q[1])
    M12 = m2 * r2**2 + m2 * r1 * r2 * c2
    M11 = (m1 + m2) * r1**2 + m2 * r2**2 + 2 * m2 * r1 * r2 * c2 + J1
    C = np.array([[-b * eta[1], -b * (eta[0] + eta[1])], [b * eta[0], 0.0]])
    G2 = m2 * g * r2 * np.cos(q[0] + q[1])
    G = np.array([(m1 + m2) * g * r1 * np.cos(q[0]) + G2, G2])
    return np.array([[M11, M12], [M12, m2 * r2**2 + J2]]), C, G


def test_bounds_of_the_papers_arm_agree_with_a_fine_grid():
    angles = np.linspace(-np.pi, np.pi, 121)
    turns = [np.array([np.cos(a), np.sin(a)]) for a in np.linspace(0, np.pi, 91)]
    least, most, turning, weight = np.inf, 0.0, 0.0, 0.0
    for q2 in angles:
        M, *_ = two_link((0.0, q2), turns[0])
        sizes = np.linalg.eigvalsh(M)
        least, most = min(least, sizes[0]), max(most, sizes[-1])
        for eta in turns:
            turning = max(turning, np.linalg.norm(two_link((0.0, q2), eta)[1], 2))
        for q1 in angles:
            weight = max(weight, np.linalg.norm(two_link((q1, q2), turns[0])[2]))
    ours = bounds_of("two_link_arm", {}, 2)
    found = (ours.lambda_m, ours.lambda_M, ours.lambda_c, ours.lambda_g)
    np.testing.assert_allclose(found, (least, most, turning, weight), rtol=1e-3)
    assert np.all(np.array(found[1:]) >= np.array((most, turning, weight)) * (1 - 1e-12))
    assert ours.source == "exact"


def test_lambda_c_of_two_links_agrees_with_a_search():
    def turning(angle):
        return np.linalg.norm(two_link((0.0, np.pi / 2), (np.cos(angle), np.sin(angle)))[1], 2)

    best = minimize_scalar(lambda angle: -turning(angle), bracket=(0.9, 1.0, 1.1), tol=1e-10)
    assert bounds_of("two_link_arm", {}, 2).lambda_c == pytest.approx(-best.fun, rel=1e-12)


def test_the_general_arm_has_the_bounds_of_the_papers_arm():
    numbers = {"m": [0.5, 1.5], "r": [1.0, 0.8], "c": [1.0, 0.8], "I": 0.0, "J": 5.0}
    assert bounds_of("n_link_arm", numbers, 2) == bounds_of("two_link_arm", {}, 2)


def mass_of(q, mass, r, c, own, J):
    """Return M(q) of a planar arm from the velocities of its centres of mass."""
    n, phi = len(q), np.cumsum(q)
    M = np.diag(J)
    for i in range(n):
        jacobian = np.zeros((2, n))
        for k in range(i + 1):
            length = c[i] if k == i else r[k]
            jacobian[:, : k + 1] += (length * np.array([-np.sin(phi[k]), np.cos(phi[k])]))[:, None]
        turn = (np.arange(n) <= i).astype(float)
        M = M + mass[i] * jacobian.T @ jacobian + own[i] * np.outer(turn, turn)
    return M


@pytest.mark.parametrize("n", [1, 3, 4])
def test_bounds_of_longer_arms_are_safe_and_reached_when_exact(n):
    """C by Christoffel's symbols, of differences of M."""
    rng = np.random.default_rng(n)
    mass, r, c, own, J = rng.uniform(0.3, 2.0, (5, n))
    ours = arm(mass, r, c, own, J, 9.8)
    largest, turning = 0.0, 0.0
    for _ in range(60):
        q, eta = rng.uniform(-np.pi, np.pi, n), rng.normal(size=n)
        eta /= np.linalg.norm(eta)
        sizes = np.linalg.eigvalsh(mass_of(q, mass, r, c, own, J))
        assert ours.lambda_m <= sizes[0]
        assert sizes[-1] <= ours.lambda_M * (1 + 1e-12)
        step = 1e-5
        dM = np.array(
            [
                (mass_of(q + e, mass, r, c, own, J) - mass_of(q - e, mass, r, c, own, J)) / 2e-5
                for e in step * np.eye(n)
            ]
        )  # dM[k, i, j] = ∂M_ij/∂q_k
        C = (
            np.einsum("kij,k->ij", dM, eta)
            + np.einsum("jik,k->ij", dM, eta)
            - np.einsum("ijk,k->ij", dM, eta)
        ) / 2
        turning = max(turning, float(np.linalg.norm(C, 2)))
    for posture in np.ndindex(*(2,) * n):
        straight = np.diff(np.pi * np.array(posture), prepend=0.0)
        largest = max(largest, np.linalg.eigvalsh(mass_of(straight, mass, r, c, own, J))[-1])
    assert turning <= ours.lambda_c + 1e-6
    assert ours.lambda_M == pytest.approx(largest, rel=1e-12)
    height = np.cumsum(r) - r + c
    pull = np.array(
        [
            9.8 * sum(mass[i] * (height[i] - (np.cumsum(r) - r)[k]) for i in range(k, n))
            for k in range(n)
        ]
    )
    assert ours.lambda_g == pytest.approx(np.linalg.norm(pull), rel=1e-12)


def test_a_point_mass_is_bounded_by_its_mass_and_drag():
    drag = Bounds(3.0, 3.0, 0.0, 0.0, 0.5, "exact", mobility=(1 / 3, 1 / 3))
    assert bounds_of("planar_robot", {"m": 3.0}, 2) == drag


def test_unknown_plants_have_no_bounds():
    assert bounds_of("their_arm.fmu", {}, 2) is None
    for refused in (-1.0, [1.0, 2.0], "heavy"):
        assert bounds_of("two_link_arm", {"m1": refused}, 2) is None
