/* The estimate (eps, ups) of a sampled agent. At t_k = t_0 + k h, k >= 1, it jumps to
 *
 *   K (eps, ups) + G (d_eps, d_ups),   d = sum over j of w_j (received_j - own),
 *
 * over the edges j of the digraph that holds at t_k, one for positions and one for velocities, by
 * the samples that its inputs have when the step from t_k begins, which are the left limits of
 * the outputs of others; then eps moves by ups until t_{k+1}. So a master that steps all FMUs at
 * once and hands outputs over afterwards does what the orchestrator does, to the same bits. What is
 * shown is the estimate at the end of a step, at t_k the left limit, or NaN after a step past a
 * sampling time was refused, which some masters do not look at. */

#include "agent.h"

#include <math.h>

#include "plant.h"
#include "summation.h"

enum { POSITION, VELOCITY };

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

void agent_start(Instance *self)
{
    Values *v = &self->state.values;
    v->start_time = v->time;
    for (int i = 0; i < M; ++i) {
        v->position[i] = v->left_position[i] = v->position_start[i];
        v->velocity[i] = v->velocity_start[i];
    }
    plant_start(v);
    plant_follow(self, v->position, v->velocity);
}

bool agent_jump(Instance *self, double end)
{
    Values *v = &self->state.values;
    const double h = v->sampling_period, next = tick_time(v, v->ticks + 1);
    if (!(end <= next + SLACK * h)) {
        for (int i = 0; i < M; ++i)
            v->position[i] = v->velocity[i] = NAN;
        plant_lose(v);
        return core_refuse(self, "a step from t = %.10g s to %.10g s, past the sampling time %.10g s",
                           v->time, end, next);
    }
    if (!(fabs(v->time - tick_time(v, v->ticks)) <= SLACK * h))
        return true;
    const int at = digraph_at(v, v->ticks);
    for (int i = 0; i < M; ++i) {
        const double p = v->position[i], u = v->velocity[i];
        double jumped[2] = {p, u};
        if (v->ticks > 0) {
            const double dp = disagreement(v->position_weight[at], v->received_position, p, i);
            const double du = disagreement(v->velocity_weight[at], v->received_velocity, u, i);
            for (int row = POSITION; row <= VELOCITY; ++row)
                jumped[row] = (v->keep[row][POSITION] * p + v->keep[row][VELOCITY] * u) +
                              (v->gain[row][POSITION] * dp + v->gain[row][VELOCITY] * du);
        }
        v->position[i] = v->left_position[i] = jumped[POSITION];
        v->velocity[i] = jumped[VELOCITY];
    }
    plant_follow(self, v->position, v->velocity);
    return true;
}

void agent_flow(Instance *self)
{
    Values *v = &self->state.values;
    const double h = v->sampling_period;
    const bool arrives = fabs(v->time - tick_time(v, v->ticks + 1)) <= SLACK * h;
    const double since = arrives ? h : v->time - tick_time(v, v->ticks);
    for (int i = 0; i < M; ++i)
        v->position[i] = v->left_position[i] + since * v->velocity[i];
    v->ticks += arrives;
}
