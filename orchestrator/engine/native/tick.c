/* What a tick does for all robots of a worker, to the same bits as NumPy does it:
 *
 *   disagree  sum w (x_j - x_i) over each robot's in-edges
 *   state     look whether all is bounded, and write the records of the states
 *
 * Compiled with -ffp-contract=off: nothing is rounded but as it is written. */

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define EXPORTED __attribute__((visibility("default")))

/* The edges into row r are start[r] ... start[r + 1] - 1. */
typedef struct {
    size_t rows, m;
    const int64_t *start, *source;
    const double *weight;
} Edges;

/* As bus/summation.py has them. */
enum { LANES = 8, MOST = 128 };

typedef struct {
    const int64_t *source;
    const double *weight, *sent;
    size_t m;
    double own;
} Terms;

static double term(const Terms *of, size_t edge)
{
    return of->weight[edge] * (of->sent[(size_t)of->source[edge] * of->m] - of->own);
}

static double pairwise(const Terms *of, size_t first, size_t end)
{
    const size_t n = end - first;
    if (n > MOST) {
        const size_t half = first + n / 2 - n / 2 % LANES;
        const double before = pairwise(of, first, half);
        return before + pairwise(of, half, end);
    }
    size_t next = first;
    double total;
    if (n < LANES)
        total = term(of, next++);
    else {
        double r[LANES];
        for (size_t lane = 0; lane < LANES; ++lane)
            r[lane] = term(of, next++);
        while (end - next >= LANES)
            for (size_t lane = 0; lane < LANES; ++lane)
                r[lane] += term(of, next++);
        total = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
    }
    while (next < end)
        total += term(of, next++);
    return total;
}

/* `sent` has m numbers a node, `own` and `disagreement` have them a row. */
EXPORTED void disagree(const Edges *edges, const double *sent, const double *own,
                       double *disagreement)
{
    const size_t m = edges->m;
    for (size_t row = 0; row < edges->rows; ++row) {
        const size_t first = (size_t)edges->start[row], end = (size_t)edges->start[row + 1];
        for (size_t axis = 0; axis < m; ++axis) {
            const size_t at = row * m + axis;
            const Terms of = {edges->source, edges->weight, sent + axis, m, own[at]};
            double total = 0.0;
            if (end > first)
                total = term(&of, first);
            if (end > first + 1)
                total += pairwise(&of, first + 1, end);
            disagreement[at] = total;
        }
    }
}

enum { POSITION, VELOCITY, EFFORT, REFERENCE, RATE, FIELDS };

typedef struct {
    size_t rows, m;
    double limit;
    const double *q, *qd, *tau;
    unsigned char *records; /* of `size` bytes each, with numbers at these places */
    size_t size, at_k, at_time, at[FIELDS];
} State;

/* Return whether what is recorded of t, ns, is within bounds; NaN is not. */
EXPORTED bool state(const State *of, const double *reference, const double *rate, uint32_t k,
                    uint64_t t)
{
    const size_t m = of->m, bytes = m * sizeof(double);
    const double *fields[FIELDS] = {of->q, of->qd, of->tau, reference, rate};
    bool fine = true;
    for (size_t i = 0; i < of->rows * m; ++i)
        fine &= fabs(of->q[i]) <= of->limit && fabs(of->qd[i]) <= of->limit &&
                fabs(reference[i]) <= of->limit && fabs(rate[i]) <= of->limit &&
                isfinite(of->tau[i]);
    for (size_t row = 0; row < of->rows; ++row) {
        unsigned char *record = of->records + row * of->size;
        memcpy(record + of->at_k, &k, sizeof k);
        memcpy(record + of->at_time, &t, sizeof t);
        for (size_t field = 0; field < FIELDS; ++field)
            memcpy(record + of->at[field], fields[field] + row * m, bytes);
    }
    return fine;
}
