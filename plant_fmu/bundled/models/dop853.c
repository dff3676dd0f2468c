/* x_{n+1} = x_n + h sum b_i k_i of order 8, with errors e5 and e3 of orders 5 and 3, of which
 *
 *   e5^2 / sqrt(e5^2 + e3^2 / 100)
 *
 * is of order 8 too. Nodes, a_ij, b_i and the weights of the errors are DOP853's (Hairer, Norsett
 * and Wanner, Solving Ordinary Differential Equations I, 2nd ed., II.10; the pair is Dormand and
 * Prince's), each rounded to a double. The last stage is the next step's first; it and the one
 * before are at the same time, and show how fast what is fast decays (II, IV.2). */

#include <math.h>

#include "integrator.h"
#include "mathematics.h"
#include "model.h"

static double attempt(Step *step)
{
    const Values *values = step->values;
    const int n = states_in(values);
    const double t = step->t, h = step->h, *x = step->x, *k1 = step->dx;
    double *y = step->y, last[STATES];
    double k2[STATES], k3[STATES], k4[STATES], k5[STATES], k6[STATES], k7[STATES], k8[STATES];
    double k9[STATES], k10[STATES], k11[STATES], k12[STATES];

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.05260015195876773 * k1[i]);
    model_derivatives(values, t + h * 0.05260015195876773, y, k2);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.0197250569845379 * k1[i] + 0.0591751709536137 * k2[i]);
    model_derivatives(values, t + h * 0.0789002279381516, y, k3);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.02958758547680685 * k1[i] + 0.08876275643042054 * k3[i]);
    model_derivatives(values, t + h * 0.1183503419072274, y, k4);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.2413651341592667 * k1[i] - 0.8845494793282861 * k3[i] +
                           0.924834003261792 * k4[i]);
    model_derivatives(values, t + h * 0.2816496580927726, y, k5);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.037037037037037035 * k1[i] + 0.17082860872947386 * k4[i] +
                           0.12546768756682242 * k5[i]);
    model_derivatives(values, t + h * 0.3333333333333333, y, k6);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.037109375 * k1[i] + 0.17025221101954405 * k4[i] +
                           0.06021653898045596 * k5[i] - 0.017578125 * k6[i]);
    model_derivatives(values, t + h * 0.25, y, k7);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.03709200011850479 * k1[i] + 0.17038392571223998 * k4[i] +
                           0.10726203044637328 * k5[i] - 0.015319437748624402 * k6[i] +
                           0.008273789163814023 * k7[i]);
    model_derivatives(values, t + h * 0.3076923076923077, y, k8);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.6241109587160757 * k1[i] - 3.3608926294469414 * k4[i] -
                           0.868219346841726 * k5[i] + 27.59209969944671 * k6[i] +
                           20.154067550477894 * k7[i] - 43.48988418106996 * k8[i]);
    model_derivatives(values, t + h * 0.6512820512820513, y, k9);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (0.47766253643826434 * k1[i] - 2.4881146199716677 * k4[i] -
                           0.590290826836843 * k5[i] + 21.230051448181193 * k6[i] +
                           15.279233632882423 * k7[i] - 33.28821096898486 * k8[i] -
                           0.020331201708508627 * k9[i]);
    model_derivatives(values, t + h * 0.6, y, k10);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (-0.9371424300859873 * k1[i] + 5.186372428844064 * k4[i] +
                           1.0914373489967295 * k5[i] - 8.149787010746927 * k6[i] -
                           18.52006565999696 * k7[i] + 22.739487099350505 * k8[i] +
                           2.4936055526796523 * k9[i] - 3.0467644718982196 * k10[i]);
    model_derivatives(values, t + h * 0.8571428571428571, y, k11);

    for (int i = 0; i < n; ++i)
        y[i] = x[i] + h * (2.273310147516538 * k1[i] - 10.53449546673725 * k4[i] -
                           2.0008720582248625 * k5[i] - 17.9589318631188 * k6[i] +
                           27.94888452941996 * k7[i] - 2.8589982771350235 * k8[i] -
                           8.87285693353063 * k9[i] + 12.360567175794303 * k10[i] +
                           0.6433927460157636 * k11[i]);
    for (int i = 0; i < n; ++i)
        last[i] = y[i];
    model_derivatives(values, step->t_next, y, k12);

    double e5 = 0.0, e3 = 0.0;
    for (int i = 0; i < n; ++i) {
        y[i] = x[i] + h * (0.054293734116568765 * k1[i] + 4.450312892752409 * k6[i] +
                           1.8915178993145003 * k7[i] - 5.801203960010585 * k8[i] +
                           0.3111643669578199 * k9[i] - 0.1521609496625161 * k10[i] +
                           0.20136540080403034 * k11[i] + 0.04471061572777259 * k12[i]);
        const double a = 0.01312004499419488 * k1[i] - 1.2251564463762044 * k6[i] -
                         0.4957589496572502 * k7[i] + 1.6643771824549864 * k8[i] -
                         0.35032884874997366 * k9[i] + 0.3341791187130175 * k10[i] +
                         0.08192320648511571 * k11[i] - 0.022355307863886294 * k12[i];
        const double b = -0.18980075407240762 * k1[i] + 4.450312892752409 * k6[i] +
                         1.8915178993145003 * k7[i] - 5.801203960010585 * k8[i] -
                         0.4226823213237919 * k9[i] - 0.1521609496625161 * k10[i] +
                         0.20136540080403034 * k11[i] + 0.02265179219836082 * k12[i];
        if (!isfinite(a) || !isfinite(b))
            return NAN;
        e5 = larger(e5, fabs(a) / scale(x[i], y[i]));
        e3 = larger(e3, fabs(b) / scale(x[i], y[i]));
    }
    const double both = sqrt(e5 * e5 + 0.01 * e3 * e3);
    const double error = both > 0.0 ? h * e5 * (e5 / both) / values->relative_tolerance : 0.0;
    if (error <= 1.0) {
        model_derivatives(values, step->t_next, y, step->dy);
        double apart = 0.0, rates_apart = 0.0;
        for (int i = 0; i < n; ++i) {
            if (!isfinite(step->dy[i]))
                return NAN;
            apart = larger(apart, fabs(y[i] - last[i]));
            rates_apart = larger(rates_apart, fabs(step->dy[i] - k12[i]));
        }
        step->rate = apart > 0.0 ? rates_apart / apart : 0.0;
    }
    return error;
}

const Method dop853 = {attempt, inverse_eighth_root, 0.05260015195876773};
