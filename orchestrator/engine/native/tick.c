/* What a tick does for all robots of a worker, to the same bits as NumPy does it:
 *
 *   disagree  sum w (x_j - x_i) over each robot's in-edges
 *   state     look whether all is bounded, and write the records of the states
 *   advance   hand references to the FMUs and step them, flow to the left limits, then state, and
 *             at t_k write the records of the samples
 *   receive   take what nodes sent
 *   jump      receive, disagree over both, and jump by it where that is of a form that is known here
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
static bool state_into(unsigned char *records, const State *of, const double *reference,
                       const double *rate, uint32_t k, uint64_t t)
{
    const size_t m = of->m, bytes = m * sizeof(double);
    const double *fields[FIELDS] = {of->q, of->qd, of->tau, reference, rate};
    bool fine = true;
    for (size_t i = 0; i < of->rows * m; ++i)
        fine &= fabs(of->q[i]) <= of->limit && fabs(of->qd[i]) <= of->limit &&
                fabs(reference[i]) <= of->limit && fabs(rate[i]) <= of->limit &&
                isfinite(of->tau[i]);
    for (size_t row = 0; row < of->rows; ++row) {
        unsigned char *record = records + row * of->size;
        memcpy(record + of->at_k, &k, sizeof k);
        memcpy(record + of->at_time, &t, sizeof t);
        for (size_t field = 0; field < FIELDS; ++field)
            memcpy(record + of->at[field], fields[field] + row * m, bytes);
    }
    return fine;
}

EXPORTED bool state(const State *of, const double *reference, const double *rate, uint32_t k,
                    uint64_t t)
{
    return state_into(of->records, of, reference, rate, k, t);
}

/* As batch_calls.c has them. */
typedef size_t Exchange(const void *calls, const void *all, const void *rows, bool setting,
                        void *answer);
typedef size_t Advance(const void *calls, const void *all, const void *rows, double start,
                       double length, void *answer);

/* The robots of one FMU, which are some rows of all: instance i is robot rows[i], and has `width`
 * numbers in `reference`, 2 m and perhaps the time from when on they hold, and 3 m in `outputs`. */
typedef struct {
    Exchange *exchange;
    Advance *advance;
    const void *setting, *stepping, *all, *given, *read;
    void *answer;
    size_t n, width;
    const int64_t *rows;
    double *reference;
    const double *outputs;
} Group;

/* What advance() returns; of those after UNBOUNDED, `at_group` and `at_instance` say where. */
enum { FINE, UNBOUNDED, NOT_HELD, NOT_STEPPED, NOT_FINITE };

/* How a jump follows from the disagreements, a of positions and b of velocities:
 * FIRST: position + alpha a, velocity + beta b; SECOND: velocity + (alpha a + beta b). */
enum { FIRST, SECOND };

/* All arrays have a row of m numbers a robot, those that were sent a row a node. */
typedef struct {
    const State *state;
    Group *groups;
    size_t n_groups, at_group, at_instance;
    double *q, *qd, *tau; /* as in `state` */
    double *position, *velocity, *left_position, *left_velocity;
    double *sent_position, *sent_velocity, *apart, *veer;
    const int64_t *robots;
    unsigned char *samples; /* of `size` bytes each, as above; k stands before them */
    size_t size, at_k, at_time, at_position, at_velocity;
    double time; /* s, that the plants have reached */
    double alpha, beta;
    int form;
} Tick;

static int ended(Tick *tick, size_t group, size_t instance, int how)
{
    tick->at_group = group;
    tick->at_instance = instance;
    return how;
}

static int hold(Tick *tick)
{
    const size_t m = tick->state->m, bytes = m * sizeof(double);
    for (size_t g = 0; g < tick->n_groups; ++g) {
        const Group *of = &tick->groups[g];
        for (size_t i = 0; i < of->n; ++i) {
            const size_t row = (size_t)of->rows[i] * m;
            double *reference = of->reference + i * of->width;
            memcpy(reference, tick->position + row, bytes);
            memcpy(reference + m, tick->velocity + row, bytes);
            for (size_t j = 2 * m; j < of->width; ++j)
                reference[j] = tick->time;
        }
        const size_t reached = of->exchange(of->setting, of->all, of->given, true, of->answer);
        if (reached < of->n)
            return ended(tick, g, reached, NOT_HELD);
    }
    return FINE;
}

static int step(Tick *tick, double start, double length)
{
    const size_t m = tick->state->m, bytes = m * sizeof(double);
    for (size_t g = 0; g < tick->n_groups; ++g) {
        const Group *of = &tick->groups[g];
        const size_t reached =
            of->advance(of->stepping, of->all, of->read, start, length, of->answer);
        if (reached < of->n)
            return ended(tick, g, reached, NOT_STEPPED);
        for (size_t i = 0; i < 3 * m * of->n; ++i)
            if (!isfinite(of->outputs[i]))
                return ended(tick, g, i / (3 * m), NOT_FINITE);
    }
    tick->time = start + length;
    for (size_t g = 0; g < tick->n_groups; ++g) {
        const Group *of = &tick->groups[g];
        for (size_t i = 0; i < of->n; ++i) {
            const size_t row = (size_t)of->rows[i] * m;
            const double *outputs = of->outputs + i * 3 * m;
            memcpy(tick->q + row, outputs, bytes);
            memcpy(tick->qd + row, outputs + m, bytes);
            memcpy(tick->tau + row, outputs + 2 * m, bytes);
        }
    }
    return FINE;
}

/* Advance by `length` from `start`, `since` after the last jump, to t, ns; all else in s. The
 * states become the records of a slot; where t is t_k, samples are `sent`. */
EXPORTED int advance(Tick *tick, bool holds, double start, double length, double since, uint32_t k,
                     uint64_t t, size_t slot, bool sent)
{
    const State *of = tick->state;
    const size_t count = of->rows * of->m, bytes = of->m * sizeof(double);
    int how = holds ? hold(tick) : FINE;
    if (how == FINE)
        how = step(tick, start, length);
    if (how != FINE)
        return how;
    for (size_t i = 0; i < count; ++i) {
        tick->left_position[i] = tick->position[i] + since * tick->velocity[i];
        tick->left_velocity[i] = tick->velocity[i];
    }
    if (!state_into(of->records + slot * of->rows * of->size, of, tick->left_position,
                    tick->left_velocity, k, t))
        return UNBOUNDED;
    if (sent)
        memcpy(tick->samples - sizeof k, &k, sizeof k);
    for (size_t row = 0; sent && row < of->rows; ++row) {
        unsigned char *record = tick->samples + row * tick->size;
        memcpy(record + tick->at_k, &k, sizeof k);
        memcpy(record + tick->at_time, &t, sizeof t);
        memcpy(record + tick->at_position, tick->left_position + row * of->m, bytes);
        memcpy(record + tick->at_velocity, tick->left_velocity + row * of->m, bytes);
    }
    return FINE;
}

static void take(const Tick *tick, size_t node, const unsigned char *record)
{
    const size_t m = tick->state->m, bytes = m * sizeof(double);
    memcpy(tick->sent_position + node * m, record + tick->at_position, bytes);
    memcpy(tick->sent_velocity + node * m, record + tick->at_velocity, bytes);
}

/* The target's record, and the batch of all robots' samples: k, and the records. */
EXPORTED void receive(const Tick *tick, const unsigned char *target, const unsigned char *robots)
{
    take(tick, 0, target);
    for (size_t row = 0; row < tick->state->rows; ++row)
        take(tick, (size_t)tick->robots[row], robots + sizeof(uint32_t) + row * tick->size);
}

/* Return whether all is finite after the jump. */
EXPORTED bool jump(Tick *tick, const unsigned char *target, const unsigned char *robots,
                   const Edges *positions, const Edges *velocities)
{
    const size_t count = tick->state->rows * tick->state->m;
    const double *left = tick->left_position, *rate = tick->left_velocity;
    const double alpha = tick->alpha, beta = tick->beta;
    bool finite = true;
    receive(tick, target, robots);
    disagree(positions, tick->sent_position, left, tick->apart);
    disagree(velocities, tick->sent_velocity, rate, tick->veer);
    for (size_t i = 0; i < count; ++i) {
        const double a = tick->apart[i], b = tick->veer[i];
        if (tick->form == FIRST) {
            tick->position[i] = left[i] + alpha * a;
            tick->velocity[i] = rate[i] + beta * b;
        } else {
            tick->position[i] = left[i];
            tick->velocity[i] = rate[i] + (alpha * a + beta * b);
        }
        finite &= isfinite(tick->position[i]) && isfinite(tick->velocity[i]);
    }
    return finite;
}
