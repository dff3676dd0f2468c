/* d/dt (q, qd) = (qd, acceleration(q, qd, tau_applied + tau_d)), where
 *
 *   tau_applied = tau + kp (eps(t) - q) + kd (ups(t) - qd)
 *   eps(t)      = reference_position + s reference_velocity + s s/2 acceleration_ref
 *   ups(t)      = reference_velocity + s acceleration_ref,   s = t - reference_time
 *   tau_d       = offset + rate t + sum of amplitude sin(frequency t + phase)
 *
 * The reference flows: position_ref reads eps(t) and velocity_ref ups(t), and setting
 * one of the three restarts it at the time of the call. Whatever is not set keeps its
 * value at that instant, so a new velocity alone leaves eps continuous, and a new
 * position holds in whichever order and number of calls they are set. A line is
 * followed without the terms of an acceleration, which might turn -0 into 0. */

#include "robot.h"

#include <math.h>

#include "model.h"

static double reference(const Values *v, double t, int i)
{
    const double s = t - v->reference_time;
    const double line = v->reference_position[i] + s * v->reference_velocity[i];
    return v->acceleration_ref[i] == 0.0 ? line : line + s * s / 2 * v->acceleration_ref[i];
}

static double reference_rate(const Values *v, double t, int i)
{
    const double s = t - v->reference_time;
    return v->acceleration_ref[i] == 0.0 ? v->reference_velocity[i]
                                         : v->reference_velocity[i] + s * v->acceleration_ref[i];
}

static void applied(const Values *v, double t, const double q[M], const double qd[M],
                    double tau[M])
{
    const int m = m_of(v);
    double e[M], ed[M];
    for (int i = 0; i < m; ++i) {
        e[i] = reference(v, t, i) - q[i];
        ed[i] = reference_rate(v, t, i) - qd[i];
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
               sin(v->disturbance_frequency[i][k] * t + v->disturbance_phase[i][k]);
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
    for (int i = 0; i < m_of(values); ++i) {
        values->position_ref[i] = reference(values, values->time, i);
        values->velocity_ref[i] = reference_rate(values, values->time, i);
    }
    applied(values, values->time, values->q, values->qd, values->tau_applied);
}

static void restart_reference(Values *values)
{
    values->reference_time = values->time;
    for (int i = 0; i < m_of(values); ++i) {
        values->reference_position[i] = values->position_ref[i];
        values->reference_velocity[i] = values->velocity_ref[i];
    }
}

static void count_terms(Values *values)
{
    for (int i = 0; i < m_of(values); ++i) {
        int n = terms_of(values);
        while (n > 0 && values->disturbance_amplitude[i][n - 1] == 0.0)
            --n;
        values->disturbance_terms[i] = n;
    }
}

void model_start(Values *values)
{
    restart_reference(values);
}

void model_was_set(Values *values, size_t index)
{
    if (IS_PART_OF(index, position_ref) || IS_PART_OF(index, velocity_ref) ||
        IS_PART_OF(index, acceleration_ref))
        restart_reference(values);
    if (IS_PART_OF(index, disturbance_amplitude))
        count_terms(values);
}
