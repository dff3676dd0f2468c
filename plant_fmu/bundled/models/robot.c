/* d/dt (q, qd) = (qd, acceleration(q, qd, tau_applied + tau_d)), with tau_applied of controller.c and
 *
 *   tau_d = offset + rate t + sum of amplitude sin(frequency t + phase) */

#include "robot.h"

#include "controller.h"
#include "mathematics.h"
#include "model.h"

static double disturbance(const Values *v, double t, int i)
{
    double sum = v->disturbance_offset[i] + v->disturbance_rate[i] * t;
    const int terms = (int)v->disturbance_terms[i];
    for (int k = 0; k < terms; ++k)
        sum += v->disturbance_amplitude[i][k] *
               sine(v->disturbance_frequency[i][k] * t + v->disturbance_phase[i][k]);
    return sum;
}

/* What is applied, and where it integrates the rate of that. */
static void control_all(const Values *values, double t, const double x[STATES],
                        double integral_now[M], double force[M])
{
    const int m = m_of(values);
    Control now;
    control(values, t, x, x + m, x + 2 * m, &now);
    for (int i = 0; i < m; ++i)
        force[i] = now.applied[i];
    if (values->integrates != 0.0)
        integral_rate(values, &now, integral_now);
}

void model_derivatives(const Values *values, double t, const double x[STATES],
                       double dx[STATES])
{
    const int m = m_of(values);
    const double *q = x, *qd = x + m;
    double error[M], force[M];
    if (values->more_than_pd == 0.0)
        pd_alone(values, t, q, qd, error, force);
    else
        control_all(values, t, x, dx + 2 * m, force);
    for (int i = 0; i < m; ++i) {
        force[i] += disturbance(values, t, i);
        dx[i] = qd[i];
    }
    robot_acceleration(values, q, qd, force, dx + m);
}

void model_outputs(Values *values)
{
    Control now;
    control(values, values->time, values->q, values->qd, values->integral, &now);
    for (int i = 0; i < m_of(values); ++i) {
        values->tau_applied[i] = now.applied[i];
        values->tau_missing[i] = now.asked[i] - now.applied[i];
    }
}

void model_locals(Values *values)
{
    values->integrates = 0.0;
    for (int i = 0; i < m_of(values); ++i) {
        for (int j = 0; j < m_of(values); ++j)
            if (values->ki[i][j] != 0.0)
                values->integrates = 1.0;
        int n = terms_of(values);
        while (n > 0 && values->disturbance_amplitude[i][n - 1] == 0.0)
            --n;
        values->disturbance_terms[i] = n;
    }
    values->more_than_pd = is_more_than_pd(values);
}
