/* A step from x to y is accepted when, in the maximum norm,
 *
 *   |the method's estimate of the error| <= rtol (1 + max(|x|, |y|)).
 *
 * The next step is the one at which the error would be a little less than what is allowed. An
 * interval begins with the step with which the last one ended, or, where the right-hand side
 * jumps at its beginning, with the one that was right after the last jump.
 *
 * A method of order 8 that is not asked for by name gives way to the implicit one, for good, once
 * in one interval stability has limited so many steps that the latter costs less. */

#include "integrator.h"

#include <math.h>
#include <stddef.h>

#include "core.h"
#include "model.h"

enum { MOST_STEPS = 1000000, MOST_LIMITED = 80 };

static const double LIMIT = 4.0; /* of step times rate; from 6 on DOP853 is unstable */
static const double SAFETY = 0.95, SHRINK = 0.1, GROW = 10.0;

double scale(double a, double b)
{
    return 1.0 + larger(fabs(a), fabs(b));
}

/* NULL of a number that names none. */
static const Method *method_of(const Values *values, const Pace *pace)
{
    if (values->integrator == 0.0)
        return pace->is_stiff ? &implicit_euler : &dop853;
    if (values->integrator == 5.0)
        return &dormand_prince;
    if (values->integrator == 10.0)
        return &implicit_euler;
    return values->integrator == 8.0 ? &dop853 : NULL;
}

bool integrator_is_known(const Instance *self, const Values *values)
{
    const Pace none = {0.0, 0.0, 0};
    return method_of(values, &none) ||
           core_refuse(self, "integrator: expected 0, 5, 8 or 10, got %g", values->integrator);
}

static bool all_finite(int n, const double x[STATES])
{
    for (int i = 0; i < n; ++i)
        if (!isfinite(x[i]))
            return false;
    return true;
}

static double first_step(int n, const Step *at, const Method *method, double rtol)
{
    double rate = 0.0;
    for (int i = 0; i < n; ++i)
        rate = larger(rate, fabs(at->dx[i]) / scale(at->x[i], at->x[i]));
    return 1.0 / (method->inverse_root(rtol) * larger(rate, 1e-3));
}

/* The part of a step that would have an error a little less than what is allowed. */
static double growth(const Method *method, double error, double most)
{
    return error > 0.0 ? smaller(SAFETY * method->inverse_root(error), most) : most;
}

Outcome integrate(Values *values, double end, bool jumped, Pace *pace)
{
    const int n = states_in(values);
    const Method *method = method_of(values, pace);
    const double rtol = values->relative_tolerance;
    double grow = GROW;
    int limited = 0;
    Step now = {.values = values};

    get_states(values, now.x);
    get_derivatives(values, now.dx);
    if (!all_finite(n, now.dx))
        return NOT_FINITE;
    if (jumped && pace->after_jump > 0.0)
        pace->step = pace->after_jump;
    if (pace->step == 0.0)
        pace->step = first_step(n, &now, method, rtol);

    for (int trial = 0; trial < MOST_STEPS; ++trial) {
        const double left = end - values->time;
        const bool last = pace->step >= left;
        now.t = values->time;
        now.h = last ? left : smaller(pace->step, left / 2.0);
        now.t_next = last ? end : now.t + now.h;
        const double error = method->attempt(&now);

        if (error <= 1.0) {
            const double next = now.h * growth(method, error, grow);
            if (jumped)
                pace->after_jump = next;
            jumped = false;
            pace->step = last ? larger(pace->step, next) : next; /* the last may be cut short */
            grow = GROW;
            values->time = now.t_next;
            for (int i = 0; i < n; ++i) {
                now.x[i] = now.y[i];
                now.dx[i] = now.dy[i];
            }
            set_states(values, now.x);
            set_derivatives(values, now.dx);
            if (last)
                return REACHED;
            limited += now.h * now.rate > LIMIT;
            if (limited > MOST_LIMITED && values->integrator == 0.0) {
                pace->is_stiff = 1;
                method = method_of(values, pace);
                now.rate = 0.0;
            }
        } else {
            const double part = isfinite(error) ? growth(method, error, 1.0) : SHRINK;
            pace->step = now.h * larger(part, SHRINK);
            grow = 1.0;
            if (now.t + pace->step * method->first_node == now.t)
                return isfinite(error) ? STEP_UNDERFLOW : NOT_FINITE;
        }
    }
    return TOO_MANY_STEPS;
}
