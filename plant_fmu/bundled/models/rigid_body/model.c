/* qdd of a rigid-body model, by straight-line code that was generated for it. */

#include <stddef.h>

#include "robot.h"

/* dynamics.c: (q, qd, force) to qdd, each of M numbers; it needs no workspace. */
int forward_dynamics(const double **arguments, double **results, int *integers, double *reals,
                     int memory);

void robot_acceleration(const Values *p, const double q[M], const double qd[M],
                        const double force[M], double qdd[M])
{
    const double *arguments[] = {q, qd, force};
    double *results[] = {qdd};
    (void)p;
    forward_dynamics(arguments, results, NULL, NULL, 0);
}
