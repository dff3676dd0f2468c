/* x_{n+1} = x_n + h sum b_i k_i is accepted when, in the maximum norm,
 *
 *   |h sum (b_i - b*_i) k_i| <= rtol (1 + max(|x_n|, |x_{n+1}|)),
 *
 * b of order 5, b* of order 4 (Dormand and Prince, J. Comput. Appl. Math. 6, 1980).
 * The seventh stage is the next step's first. The next step is the one at which the
 * error, of order h^5, would be a little less than what is allowed. */

#include "dormand_prince.h"

#include <math.h>
#include <stdbool.h>

#include "model.h"

enum { MOST_STEPS = 1000000 };

static const double SAFETY = 0.95, SHRINK = 0.1, GROW = 10.0;

static double scale(double a, double b)
{
    return 1.0 + fmax(fabs(a), fabs(b));
}

static double first_step(int n, const double x[STATES], const double dx[STATES], double rtol)
{
    double rate = 0.0;
    for (int i = 0; i < n; ++i)
        rate = fmax(rate, fabs(dx[i]) / scale(x[i], x[i]));
    return pow(rtol, 0.2) / fmax(rate, 1e-3);
}

/* One trial step: x and k1 to y and k7. Returns its error in units of rtol, NaN when
 * a stage is not finite. */
static double attempt(const Values *values, double t, double h, double t_next,
                      const double x[STATES], const double k1[STATES], double y[STATES],
                      double k7[STATES])
{
    const int n = states_in(values);
    double k2[STATES], k3[STATES], k4[STATES], k5[STATES], k6[STATES];

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (1.0 / 5.0 * k1[i]);
    model_derivatives(values, t + h * (1.0 / 5.0), y, k2);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (3.0 / 40.0 * k1[i] + 9.0 / 40.0 * k2[i]);
    model_derivatives(values, t + h * (3.0 / 10.0), y, k3);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (44.0 / 45.0 * k1[i] - 56.0 / 15.0 * k2[i] + 32.0 / 9.0 * k3[i]);
    model_derivatives(values, t + h * (4.0 / 5.0), y, k4);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (19372.0 / 6561.0 * k1[i] - 25360.0 / 2187.0 * k2[i] +
                           64448.0 / 6561.0 * k3[i] - 212.0 / 729.0 * k4[i]);
    model_derivatives(values, t + h * (8.0 / 9.0), y, k5);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (9017.0 / 3168.0 * k1[i] - 355.0 / 33.0 * k2[i] +
                           46732.0 / 5247.0 * k3[i] + 49.0 / 176.0 * k4[i] -
                           5103.0 / 18656.0 * k5[i]);
    model_derivatives(values, t_next, y, k6);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (35.0 / 384.0 * k1[i] + 500.0 / 1113.0 * k3[i] +
                           125.0 / 192.0 * k4[i] - 2187.0 / 6784.0 * k5[i] +
                           11.0 / 84.0 * k6[i]);
    model_derivatives(values, t_next, y, k7);

    double error = 0.0;
    for (int i = 0; i < n; ++i) {
        const double e = h * (71.0 / 57600.0 * k1[i] - 71.0 / 16695.0 * k3[i] +
                              71.0 / 1920.0 * k4[i] - 17253.0 / 339200.0 * k5[i] +
                              22.0 / 525.0 * k6[i] - 1.0 / 40.0 * k7[i]);
        if (isnan(e))
            return e;
        error = fmax(error, fabs(e) / scale(x[i], y[i]));
    }
    return error;
}

Outcome dormand_prince(Values *values, double end, double *step)
{
    const int n = states_in(values);
    const double rtol = values->relative_tolerance;
    double x[STATES], k1[STATES], grow = GROW;

    get_states(values, x);
    get_derivatives(values, k1);
    for (int i = 0; i < n; ++i)
        if (!isfinite(k1[i]))
            return NOT_FINITE;
    if (*step == 0.0)
        *step = first_step(n, x, k1, rtol);

    for (int trial = 0; trial < MOST_STEPS; ++trial) {
        double y[STATES], k7[STATES];
        const double t = values->time, left = end - t;
        const bool last = *step >= left;
        const double h = last ? left : fmin(*step, left / 2.0);
        const double t_next = last ? end : t + h;
        const double error = attempt(values, t, h, t_next, x, k1, y, k7) / rtol;

        if (error <= 1.0) {
            const double next = h * fmin(SAFETY * pow(error, -0.2), grow);
            *step = last ? fmax(*step, next) : next; /* the last one may be cut short */
            grow = GROW;
            values->time = t_next;
            for (int i = 0; i < n; ++i) {
                x[i] = y[i];
                k1[i] = k7[i];
            }
            set_states(values, x);
            set_derivatives(values, k1);
            if (last)
                return REACHED;
        } else {
            *step = h * (isfinite(error) ? fmax(SAFETY * pow(error, -0.2), SHRINK) : SHRINK);
            grow = 1.0;
            if (t + *step / 5.0 == t)
                return isfinite(error) ? STEP_UNDERFLOW : NOT_FINITE;
        }
    }
    return TOO_MANY_STEPS;
}
