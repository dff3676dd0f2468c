/* Dormand and Prince's pair: x_{n+1} = x_n + h sum b_i k_i, the error h sum (b_i - b*_i) k_i, b of
 * order 5, b* of order 4 (J. Comput. Appl. Math. 6, 1980). The seventh stage is the next step's
 * first. */

#include <math.h>

#include "integrator.h"
#include "mathematics.h"
#include "model.h"

static double attempt(Step *step)
{
    const Values *values = step->values;
    const int n = states_in(values);
    const double t = step->t, h = step->h, *x = step->x, *k1 = step->dx;
    double *y = step->y, *k7 = step->dy;
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
    model_derivatives(values, step->t_next, y, k6);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (35.0 / 384.0 * k1[i] + 500.0 / 1113.0 * k3[i] +
                           125.0 / 192.0 * k4[i] - 2187.0 / 6784.0 * k5[i] +
                           11.0 / 84.0 * k6[i]);
    model_derivatives(values, step->t_next, y, k7);

    double error = 0.0;
    for (int i = 0; i < n; ++i) {
        const double e = h * (71.0 / 57600.0 * k1[i] - 71.0 / 16695.0 * k3[i] +
                              71.0 / 1920.0 * k4[i] - 17253.0 / 339200.0 * k5[i] +
                              22.0 / 525.0 * k6[i] - 1.0 / 40.0 * k7[i]);
        if (isnan(e))
            return e;
        error = larger(error, fabs(e) / scale(x[i], y[i]));
    }
    return error / values->relative_tolerance;
}

const Method dormand_prince = {attempt, inverse_fifth_root, 1.0 / 5.0};
