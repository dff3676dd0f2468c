/* m qdd = force - d qd */

#include "robot.h"

void robot_acceleration(const Values *p, const double q[M], const double qd[M],
                        const double force[M], double qdd[M])
{
    (void)q;
    for (int i = 0; i < M; ++i)
        qdd[i] = (force[i] - p->d * qd[i]) / p->m;
}
