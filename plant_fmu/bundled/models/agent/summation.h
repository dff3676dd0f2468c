/* Sums in the order that results rest on: P adds pairwise what are 8 or more, and in turn what are
 * fewer; of what a robot receives, the first is added last. */

#ifndef SUMMATION_H
#define SUMMATION_H

#include <stddef.h>

enum { LANES = 8, BLOCK = 128 };

static inline double sum_pairwise(const double x[], size_t n)
{
    if (n > BLOCK) {
        const size_t half = n / 2 - n / 2 % LANES;
        const double first = sum_pairwise(x, half);
        return first + sum_pairwise(x + half, n - half);
    }
    size_t next = n < LANES ? n > 0 : LANES;
    double total = n > 0 ? x[0] : 0.0;
    if (n >= LANES) {
        double r[LANES];
        for (size_t lane = 0; lane < LANES; ++lane)
            r[lane] = x[lane];
        for (; n - next >= LANES; next += LANES)
            for (size_t lane = 0; lane < LANES; ++lane)
                r[lane] += x[next + lane];
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
    }
    for (; next < n; ++next)
        total += x[next];
    return total;
}

static inline double sum_from_first(const double x[], size_t n)
{
    if (n < 2)
        return n ? x[0] : 0.0;
    return x[0] + sum_pairwise(x + 1, n - 1);
}

#endif
