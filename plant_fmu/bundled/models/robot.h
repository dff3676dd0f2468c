/* What a robot adds to robot.c: its equations of motion, and nothing else. */

#ifndef ROBOT_H
#define ROBOT_H

#include "variables.h"

/* The acceleration of the robot with parameters p under the generalised force
 * tau + PD + disturbance. Vectors hold m_of(p) numbers. */
void robot_acceleration(const Values *p, const double q[M], const double qd[M],
                        const double force[M], double qdd[M]);

#endif
