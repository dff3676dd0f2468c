/* Euler's linearly implicit method in n = 1, 2, ... parts of a step, extrapolated to infinitely
 * many (Deuflhard, SIAM Review 27, 1985; Hairer and Wanner, Solving Ordinary Differential Equations
 * II, IV.9):
 *
 *   T_{n,1} = the method in n parts,
 *   T_{n,j+1} = T_{n,j} + (T_{n,j} - T_{n-1,j}) / (n/(n-j) - 1),
 *
 * y = T_{K,K}, of order K, with the error T_{K,K} - T_{K,K-1}. With q' = v and w' = g(t, q, w), w
 * being v and what comes after it, a part of length h is, by the Jacobian at the step's beginning,
 *
 *   (1 - h g_w - h h g_q dv/dw) dw = h g(t + h, q, w) + h h g_q v,   dq = h (v + dv).
 *
 * What decays however fast within a step is off by some 1e-6 of itself at most, and not limited by
 * stability. */

#include <math.h>

#include "integrator.h"
#include "mathematics.h"
#include "model.h"

enum { K = 10 };

typedef struct {
    int m, p; /* how many q and w there are */
    double q[STATES][STATES], w[STATES][STATES]; /* g_q and g_w */
} Jacobian;

typedef struct {
    double factors[STATES][STATES];
    int pivot[STATES];
} Factored;

/* By differences of 2^-26 of a number. */
static void differentiate(const Step *step, Jacobian *J)
{
    const int m = J->m, n = J->m + J->p;
    double x[STATES], dx[STATES];
    for (int j = 0; j < n; ++j)
        x[j] = step->x[j];
    for (int j = 0; j < n; ++j) {
        x[j] += scale(x[j], x[j]) * 0x1p-26;
        const double by = x[j] - step->x[j];
        model_derivatives(step->values, step->t, x, dx);
        for (int i = 0; i < J->p; ++i)
            *(j < m ? &J->q[i][j] : &J->w[i][j - m]) = (dx[m + i] - step->dx[m + i]) / by;
        x[j] = step->x[j];
    }
}

/* Gauss, the greatest number of a column first. */
static void factorise(const Jacobian *J, double h, Factored *of)
{
    const int p = J->p;
    double(*a)[STATES] = of->factors;
    for (int i = 0; i < p; ++i)
        for (int j = 0; j < p; ++j)
            a[i][j] = (i == j) - h * (j < J->m ? J->w[i][j] + h * J->q[i][j] : J->w[i][j]);
    for (int k = 0; k < p; ++k) {
        int best = k;
        for (int i = k + 1; i < p; ++i)
            if (fabs(a[i][k]) > fabs(a[best][k]))
                best = i;
        of->pivot[k] = best;
        for (int j = 0; best != k && j < p; ++j) {
            const double kept = a[k][j];
            a[k][j] = a[best][j];
            a[best][j] = kept;
        }
        a[k][k] = 1.0 / a[k][k];
        for (int i = k + 1; i < p; ++i) {
            a[i][k] *= a[k][k];
            for (int j = k + 1; j < p; ++j)
                a[i][j] -= a[i][k] * a[k][j];
        }
    }
}

static void solve(const Factored *of, int p, double b[STATES])
{
    const double(*a)[STATES] = of->factors;
    for (int k = 0; k < p; ++k) {
        const double kept = b[of->pivot[k]];
        b[of->pivot[k]] = b[k];
        b[k] = kept;
    }
    for (int i = 0; i < p; ++i)
        for (int j = 0; j < i; ++j)
            b[i] -= a[i][j] * b[j];
    for (int i = p - 1; i >= 0; --i) {
        for (int j = i + 1; j < p; ++j)
            b[i] -= a[i][j] * b[j];
        b[i] *= a[i][i];
    }
}

/* T_{n,1} to y. */
static void in_parts(const Step *step, const Jacobian *J, int n, double y[STATES])
{
    const int m = J->m;
    const double h = step->h / n;
    double dx[STATES], dw[STATES];
    Factored factored;
    factorise(J, h, &factored);
    for (int i = 0; i < m + J->p; ++i)
        y[i] = step->x[i];
    for (int part = 1; part <= n; ++part) {
        model_derivatives(step->values, part == n ? step->t_next : step->t + part * h, y, dx);
        for (int i = 0; i < J->p; ++i) {
            double along = 0.0;
            for (int j = 0; j < m; ++j)
                along += J->q[i][j] * y[m + j];
            dw[i] = h * (dx[m + i] + h * along);
        }
        solve(&factored, J->p, dw);
        for (int i = 0; i < J->p; ++i)
            y[m + i] += dw[i];
        for (int i = 0; i < m; ++i)
            y[i] += h * y[m + i];
    }
}

static double attempt(Step *step)
{
    const int n = states_in(step->values), m = m_of(step->values);
    double table[K][STATES], error = 0.0;
    Jacobian J;
    J.m = m;
    J.p = n - m;
    differentiate(step, &J);
    for (int row = 0; row < K; ++row) {
        in_parts(step, &J, row + 1, table[row]);
        for (int i = 0; i < n; ++i)
            if (!isfinite(table[row][i]))
                return NAN;
    }
    for (int i = 0; i < n; ++i) {
        for (int column = 1; column < K; ++column) {
            if (column == K - 1)
                step->y[i] = table[K - 1][i];
            for (int row = K - 1; row >= column; --row)
                table[row][i] += (table[row][i] - table[row - 1][i]) * (row + 1 - column) / column;
        }
        const double off = table[K - 1][i] - step->y[i];
        step->y[i] = table[K - 1][i];
        error = larger(error, fabs(off) / scale(step->x[i], step->y[i]));
    }
    model_derivatives(step->values, step->t_next, step->y, step->dy);
    for (int i = 0; i < n; ++i)
        if (!isfinite(step->dy[i]))
            return NAN;
    return error / step->values->relative_tolerance;
}

const Method implicit_euler = {attempt, inverse_tenth_root, 1.0 / K};
