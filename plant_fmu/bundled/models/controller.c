/* tau_applied = what of tau_asked is within torque_limit, with e = eps - q, ed = ups - qd and
 *
 *   u         = kp e + kd ed + ki z,   z' = e
 *   tau_asked = tau + u + gravity_compensation G(q) + acceleration_feedforward M(q) a
 *   eps(t)    = position_ref + s velocity_ref + s s/2 a,   ups(t) = velocity_ref + s a,
 *   a         = acceleration_ref,   s = max(0, t - reference_time).
 *
 * With inertia_scaling M(q) u stands for u, and the gains are those of a unit inertia. With
 * computed_torque it does too, and all that acts but tau is made up for: qdd = a + u where the limit
 * does not bind. Where e would push on beyond the limit z slows down, and rests from a tenth of the
 * limit beyond it on:
 *
 *   z' = e max(0, 1 - |tau_asked - tau_applied| / (torque_limit / 10)).
 *
 * If it stopped at the limit itself, z' would jump there, and what is asked might be driven back to
 * the limit from both sides: no solution, and steps without end.
 *
 * The reference is a function of the inputs and the time alone, however often an importer
 * sets them: it moves on from reference_time, and stays as it is where that is yet to come.
 * A line is followed without the terms of an acceleration, which might turn -0 into 0.
 *
 * The robot's acceleration is affine in the force on it: what unit forces add to it at rest is
 * the inverse of M(q), and what it is without force tells G(q) at rest, and all that acts else. */

#include "controller.h"

#include "cholesky.h"
#include "robot.h"

static const double NO_LIMIT = 1e30; /* so that a torque without end remains one, and is seen */
static const double SLACK = 0.1;     /* of the limit, in which an integral comes to rest */

/* Adds to tau the force that gives the accelerations `wanted` more than the robot has at (q, qd)
 * without any, of which the share `made_up_for` is counted. */
static void add_inverse_dynamics(const Values *v, const double q[M], const double qd[M],
                                 const double wanted[M], double made_up_for, double tau[M])
{
    const int m = m_of(v);
    const double none[M] = {0.0};
    double inverse[M][M], at_rest[M], free[M], force[M];
    robot_acceleration(v, q, none, none, at_rest);
    robot_acceleration(v, q, qd, none, free);
    for (int j = 0; j < m; ++j) {
        double push[M] = {0.0}, pushed[M];
        push[j] = 1.0;
        robot_acceleration(v, q, none, push, pushed);
        for (int i = 0; i < m; ++i)
            inverse[i][j] = pushed[i] - at_rest[i];
    }
    for (int i = 0; i < m; ++i)
        force[i] = wanted[i] - made_up_for * free[i];
    cholesky_solve(m, inverse, force);
    for (int i = 0; i < m; ++i)
        tau[i] += force[i];
}

/* Adds to tau what the law has beside that of PD alone; with inertia scaling tau is without these. */
static void add_the_rest(const Values *v, const double q[M], const double qd[M],
                         const double integral[M], double u[M], double tau[M])
{
    const int m = m_of(v);
    const double none[M] = {0.0};
    const bool computed = v->computed_torque != 0.0;
    const bool scaled = computed || v->inertia_scaling != 0.0;
    const double share = computed ? 1.0 : v->acceleration_feedforward;
    double wanted[M] = {0.0};
    for (int i = 0; i < m; ++i) {
        if (v->integrates != 0.0)
            for (int j = 0; j < m; ++j)
                u[i] += v->ki[i][j] * integral[j];
        tau[i] = scaled ? v->tau[i] : u[i];
        wanted[i] = (scaled ? u[i] - v->tau[i] : 0.0) + share * v->acceleration_ref[i];
    }
    if (computed)
        add_inverse_dynamics(v, q, qd, wanted, 1.0, tau);
    else if (scaled || v->gravity_compensation != 0.0 || v->acceleration_feedforward != 0.0)
        add_inverse_dynamics(v, q, none, wanted, v->gravity_compensation, tau);
}

bool is_more_than_pd(const Values *v)
{
    for (int i = 0; i < m_of(v); ++i)
        if (v->torque_limit[i] < NO_LIMIT)
            return true;
    return v->integrates != 0.0 || v->computed_torque != 0.0 || v->inertia_scaling != 0.0 ||
           v->gravity_compensation != 0.0 || v->acceleration_feedforward != 0.0;
}

void control(const Values *v, double t, const double q[M], const double qd[M],
             const double integral[M], Control *found)
{
    double *asked = found->asked, u[M];
    pd_alone(v, t, q, qd, found->error, u);
    for (int i = 0; i < m_of(v); ++i)
        asked[i] = u[i];
    add_the_rest(v, q, qd, integral, u, asked);
    for (int i = 0; i < m_of(v); ++i) {
        const double limit = v->torque_limit[i] < NO_LIMIT ? v->torque_limit[i] : INFINITY;
        found->applied[i] = asked[i] > limit ? limit : asked[i] < -limit ? -limit : asked[i];
    }
}

void integral_rate(const Values *v, const Control *now, double rate[M])
{
    for (int i = 0; i < m_of(v); ++i) {
        const double e = now->error[i], missing = now->asked[i] - now->applied[i];
        const double beyond = missing * e > 0.0 ? fabs(missing) / (SLACK * v->torque_limit[i]) : 0.0;
        rate[i] = beyond < 1.0 ? (1.0 - beyond) * e : 0.0;
    }
}
