/* M(q) qdd + h(q, qd) = force, from the links' angles to the horizontal, phi = L q, where
 * L sums: phi_i = q_1 + ... + q_i. Link i has its centre of mass at
 *
 *   p_i = sum over k < i of r_k e(phi_k) + c_i e(phi_i),   e(phi) = (cos phi, sin phi),
 *
 * so that with s_i = m_i c_i + r_i (m_{i+1} + ... + m_n), the first moment about joint i
 * of link i and of all mass beyond it, placed at its end,
 *
 *   kinetic energy   = 1/2 sum a_ij cos(phi_i - phi_j) phid_i phid_j + 1/2 sum J_i qd_i^2,
 *   potential energy = g sum s_i sin phi_i,
 *   a_ij = r_i s_j for i < j,   a_ii = I_i + m_i c_i^2 + r_i^2 (m_{i+1} + ... + m_n),
 *
 * and Lagrange's equations are, before they are taken back to q,
 *
 *   M_ij = a_ij cos(phi_i - phi_j),
 *   h_i  = sum over j of a_ij sin(phi_i - phi_j) phid_j^2 + g s_i cos phi_i.
 *
 * Taken back, M becomes L^T M L + diag(J) and h becomes L^T h: sums from the tip inwards.
 * M is positive definite, and M qdd = force - h is solved by Cholesky's factors; parameters
 * for which it is not give NaN. */

#include <math.h>

#include "cholesky.h"
#include "mathematics.h"
#include "robot.h"

void robot_acceleration(const Values *p, const double q[M], const double qd[M],
                        const double force[M], double qdd[M])
{
    const int n = m_of(p);
    double c_phi[M], s_phi[M], squared[M], s[M], diagonal[M], h[M], A[M][M];

    double phi = 0.0, phid = 0.0;
    for (int i = 0; i < n; ++i) {
        phi += q[i];
        phid += qd[i];
        sine_and_cosine(phi, &s_phi[i], &c_phi[i]);
        squared[i] = phid * phid;
    }

    double beyond = 0.0;
    for (int i = n - 1; i >= 0; --i) {
        s[i] = p->m[i] * p->c[i] + p->r[i] * beyond;
        diagonal[i] = p->I[i] + p->m[i] * p->c[i] * p->c[i] + p->r[i] * p->r[i] * beyond;
        beyond += p->m[i];
    }

    for (int i = 0; i < n; ++i) {
        h[i] = p->g * s[i] * c_phi[i];
        A[i][i] = diagonal[i];
        for (int j = 0; j < i; ++j) {
            const double a = p->r[j] * s[i];
            const double turn = a * (s_phi[i] * c_phi[j] - c_phi[i] * s_phi[j]);
            A[i][j] = A[j][i] = a * (c_phi[i] * c_phi[j] + s_phi[i] * s_phi[j]);
            h[i] += turn * squared[j];
            h[j] -= turn * squared[i];
        }
    }

    for (int i = n - 2; i >= 0; --i) {
        h[i] += h[i + 1];
        for (int j = 0; j < n; ++j)
            A[i][j] += A[i + 1][j];
    }
    for (int i = 0; i < n; ++i)
        for (int j = n - 2; j >= 0; --j)
            A[i][j] += A[i][j + 1];

    for (int i = 0; i < n; ++i) {
        A[i][i] += p->J[i];
        qdd[i] = force[i] - h[i];
    }
    cholesky_solve(n, A, qdd);
}
