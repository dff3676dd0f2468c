/* The law by which a robot follows its reference. */

#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdbool.h>

#include "variables.h"

typedef struct {
    double error[M], asked[M], applied[M];
} Control;

/* At time t, where the robot is at (q, qd) and the integral of its error at `integral`. */
void control(const Values *v, double t, const double q[M], const double qd[M],
             const double integral[M], Control *found);

/* The rate of the integral. */
void integral_rate(const Values *v, const Control *now, double rate[M]);

/* Whether the law is more than PD within a limit. */
bool is_more_than_pd(const Values *v);

#endif
