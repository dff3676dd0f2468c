/* What a sampled agent keeps: position, velocity, and the other fields x of law.h. At
 * t_k = t_0 + k h, k >= 1, it jumps to
 *
 *   K x + G d,   d = sum over j of w_j (received_j - own) of each field that is sent,
 *
 * over the edges j of the digraph that holds at t_k, one for velocities and one for the rest, by
 * the samples that its inputs have when the step from t_k begins, which are the left limits of
 * the outputs of others; then the position moves by the velocity until t_{k+1}, and both by the
 * acceleration where one is kept. So a master that steps all FMUs at
 * once and hands outputs over afterwards does what the orchestrator does, to the same bits. What is
 * shown is the estimate at the end of a step, at t_k the left limit, or NaN after a step past a
 * sampling time was refused, which some masters do not look at. */

#include "agent.h"

#include <math.h>

#include "law.h"
#include "plant.h"
#include "summation.h"

/* Sampling times are counted, not added up; this much of h is rounding. */
static const double SLACK = 1e-6;

static double tick_time(const Values *v, double ticks)
{
    return v->start_time + ticks * v->sampling_period;
}

/* Which digraph holds at t_k, k >= 1. */
static int digraph_at(const Values *v, double k)
{
    const double turn = v->repeat > 0.0 ? fmod(k - 1.0, v->repeat) + 1.0 : k;
    int at = 0;
    while (at + 1 < DIGRAPHS && v->since[at + 1] <= turn)
        ++at;
    return at;
}

static double disagreement(const double weight[RECEIVED], double (*received)[M], double own,
                           int axis)
{
    double terms[RECEIVED + LANES]; /* with room, or compilers fear for sums of LANES */
    size_t n = 0;
    for (int j = 0; j < RECEIVED; ++j)
        if (weight[j] != 0.0)
            terms[n++] = weight[j] * (received[j][axis] - own);
    return sum_from_first(terms, n);
}

static double product(const double a[], const double b[], int n)
{
    double sum = a[0] * b[0];
    for (int i = 1; i < n; ++i)
        sum += a[i] * b[i];
    return sum;
}

/* The estimate flows, and the plant follows it, from what it is now. */
static void start_interval(Instance *self)
{
    Values *v = &self->state.values;
    for (int i = 0; i < M; ++i) {
        v->left_position[i] = v->position[i];
#ifdef ACCELERATION
        v->left_velocity[i] = v->velocity[i];
#endif
    }
#ifdef ACCELERATION
    plant_follow(self, v->position, v->velocity, v->ACCELERATION);
#else
    plant_follow(self, v->position, v->velocity, NULL);
#endif
}

void agent_start(Instance *self)
{
    Values *v = &self->state.values;
    v->start_time = v->time;
    double *const kept[KEPT] = {KEPT_FIELDS(v)};
    const double *const initial[KEPT] = {INITIAL_FIELDS(v)};
    for (int field = 0; field < KEPT; ++field)
        for (int i = 0; i < M; ++i)
            kept[field][i] = initial[field][i];
    plant_start(v);
    start_interval(self);
}

bool agent_jump(Instance *self, double end)
{
    Values *v = &self->state.values;
    const double h = v->sampling_period, next = tick_time(v, v->ticks + 1);
    double *const kept[KEPT] = {KEPT_FIELDS(v)};
    if (!(end <= next + SLACK * h)) {
        for (int field = 0; field < KEPT; ++field)
            for (int i = 0; i < M; ++i)
                kept[field][i] = NAN;
        plant_lose(v);
        return core_refuse(self, "a step from t = %.10g s to %.10g s, past the sampling time %.10g s",
                           v->time, end, next);
    }
    if (!(fabs(v->time - tick_time(v, v->ticks)) <= SLACK * h))
        return true;
    if (v->ticks > 0) {
        const int at = digraph_at(v, v->ticks);
        double (*const received[SENT])[M] = {RECEIVED_FIELDS(v)};
        const double *const weight[SENT] = {WEIGHTS(v, at)};
        static const int own[SENT] = {SENT_FIELDS};
        for (int i = 0; i < M; ++i) {
            double x[KEPT], d[SENT];
            for (int field = 0; field < KEPT; ++field)
                x[field] = kept[field][i];
            for (int field = 0; field < SENT; ++field)
                d[field] = disagreement(weight[field], received[field], x[own[field]], i);
            for (int row = 0; row < KEPT; ++row)
                kept[row][i] = product(v->keep[row], x, KEPT) + product(v->gain[row], d, SENT);
        }
    }
    start_interval(self);
    return true;
}

void agent_flow(Instance *self)
{
    Values *v = &self->state.values;
    const double h = v->sampling_period;
    const bool arrives = fabs(v->time - tick_time(v, v->ticks + 1)) <= SLACK * h;
    const double since = arrives ? h : v->time - tick_time(v, v->ticks);
    for (int i = 0; i < M; ++i) {
#ifdef ACCELERATION
        const double a = v->ACCELERATION[i];
        v->position[i] = v->left_position[i] + since * (v->left_velocity[i] + since / 2.0 * a);
        v->velocity[i] = v->left_velocity[i] + since * a;
#else
        v->position[i] = v->left_position[i] + since * v->velocity[i];
#endif
    }
    v->ticks += arrives;
}
