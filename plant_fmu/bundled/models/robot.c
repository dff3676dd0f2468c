/* d/dt (q, qd) = (qd, acceleration(q, qd, tau_applied + tau_d)), where
 *
 *   tau_applied = tau + kp (eps(t) - q) + kd (ups(t) - qd)
 *   eps(t)      = position_ref + s velocity_ref + s s/2 acceleration_ref
 *   ups(t)      = velocity_ref + s acceleration_ref,   s = max(0, t - reference_time)
 *   tau_d       = offset + rate t + sum of amplitude sin(frequency t + phase)
 *
 * The reference is a function of the inputs and the time alone, however often an importer
 * sets them: it moves on from reference_time, and stays as it is where that is yet to come.
 * A line is followed without the terms of an acceleration, which might turn -0 into 0. */

#include "robot.h"

#include "mathematics.h"
#include "model.h"

static double since_given(const Values *v, double t)
{
    return t > v->reference_time ? t - v->reference_time : 0.0;
}

static double reference(const Values *v, double s, int i)
{
    const double line = v->position_ref[i] + s * v->velocity_ref[i];
    return v->acceleration_ref[i] == 0.0 ? line : line + s * s / 2 * v->acceleration_ref[i];
}

static double reference_rate(const Values *v, double s, int i)
{
    return v->acceleration_ref[i] == 0.0 ? v->velocity_ref[i]
                                         : v->velocity_ref[i] + s * v->acceleration_ref[i];
}

static void applied(const Values *v, double t, const double q[M], const double qd[M],
                    double tau[M])
{
    const int m = m_of(v);
    const double s = since_given(v, t);
    double e[M], ed[M];
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

static double disturbance(const Values *v, double t, int i)
{
    double sum = v->disturbance_offset[i] + v->disturbance_rate[i] * t;
    const int terms = (int)v->disturbance_terms[i];
    for (int k = 0; k < terms; ++k)
        sum += v->disturbance_amplitude[i][k] *
               sine(v->disturbance_frequency[i][k] * t + v->disturbance_phase[i][k]);
    return sum;
}

void model_derivatives(const Values *values, double t, const double x[STATES],
                       double dx[STATES])
{
    const int m = m_of(values);
    const double *q = x, *qd = x + m;
    double force[M];
    applied(values, t, q, qd, force);
    for (int i = 0; i < m; ++i) {
        force[i] += disturbance(values, t, i);
        dx[i] = qd[i];
    }
    robot_acceleration(values, q, qd, force, dx + m);
}

void model_outputs(Values *values)
{
    applied(values, values->time, values->q, values->qd, values->tau_applied);
}

void model_locals(Values *values)
{
    for (int i = 0; i < m_of(values); ++i) {
        int n = terms_of(values);
        while (n > 0 && values->disturbance_amplitude[i][n - 1] == 0.0)
            --n;
        values->disturbance_terms[i] = n;
    }
}
