/* The law by which a robot follows its reference. */

#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <stdbool.h>

#include "variables.h"

typedef struct {
    double error[M], asked[M], applied[M];
} Control;

static inline double reference(const Values *v, double s, int i)
{
    const double line = v->position_ref[i] + s * v->velocity_ref[i];
    return v->acceleration_ref[i] == 0.0 ? line : line + s * s / 2 * v->acceleration_ref[i];
}

static inline double reference_rate(const Values *v, double s, int i)
{
    return v->acceleration_ref[i] == 0.0 ? v->velocity_ref[i]
                                         : v->velocity_ref[i] + s * v->acceleration_ref[i];
}

/* e and tau + kp e + kd ed: all of the law where nothing more is on, as mostly. It is inside of
 * every evaluation of the right-hand side, and so it is here, where it is a part of that. */
static inline void pd_alone(const Values *v, double t, const double q[M], const double qd[M],
                            double e[M], double tau[M])
{
    const int m = m_of(v);
    const double s = t > v->reference_time ? t - v->reference_time : 0.0;
    double ed[M];
    for (int i = 0; i < m; ++i) {
        e[i] = reference(v, s, i) - q[i];
        ed[i] = reference_rate(v, s, i) - qd[i];
    }
    for (int i = 0; i < m; ++i) {
        tau[i] = v->tau[i];
        for (int j = 0; j < m; ++j)
            tau[i] += v->kp[i][j] * e[j] + v->kd[i][j] * ed[j];
    }
}

/* All of the law at time t, where the robot is at (q, qd) and the integral of its error at `integral`. */
void control(const Values *v, double t, const double q[M], const double qd[M],
             const double integral[M], Control *found);

/* The rate of the integral. */
void integral_rate(const Values *v, const Control *now, double rate[M]);

/* Whether the law is more than PD alone. */
bool is_more_than_pd(const Values *v);

#endif
