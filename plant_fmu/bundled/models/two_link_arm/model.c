/* M(q) qdd + C(q, qd) qd + G(q) = force, solved for qdd by Cramer's rule. */

#include "mathematics.h"
#include "robot.h"

void robot_acceleration(const Values *p, const double q[M], const double qd[M],
                        const double force[M], double qdd[M])
{
    double c1, s1, c2, s2;
    sine_and_cosine(q[0], &s1, &c1);
    sine_and_cosine(q[1], &s2, &c2);
    const double c12 = c1 * c2 - s1 * s2;
    const double mass = p->m1 + p->m2;
    const double inertia = p->m2 * p->r2 * p->r2;
    const double coupling = p->m2 * p->r1 * p->r2;

    const double M11 = mass * p->r1 * p->r1 + inertia + 2.0 * coupling * c2 + p->J1;
    const double M12 = inertia + coupling * c2;
    const double M22 = inertia + p->J2;

    const double b = coupling * s2;
    const double C1 = -b * qd[1] * (2.0 * qd[0] + qd[1]);
    const double C2 = b * qd[0] * qd[0];

    const double G2 = p->m2 * p->g * p->r2 * c12;
    const double G1 = mass * p->g * p->r1 * c1 + G2;

    const double f1 = force[0] - C1 - G1;
    const double f2 = force[1] - C2 - G2;
    const double inverse = 1.0 / (M11 * M22 - M12 * M12);

    qdd[0] = (M22 * f1 - M12 * f2) * inverse;
    qdd[1] = (M11 * f2 - M12 * f1) * inverse;
}
