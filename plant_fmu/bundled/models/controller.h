/* The law by which a robot follows its reference. */

#ifndef CONTROLLER_H
#define CONTROLLER_H

#include "variables.h"

typedef struct {
    double applied[M], missing[M]; /* what acts, and how much more was asked for */
    double integral_rate[M];
} Control;

/* At time t, where the robot is at (q, qd) and the integral of its error at `integral`. */
void control(const Values *v, double t, const double q[M], const double qd[M],
             const double integral[M], Control *found);

#endif
