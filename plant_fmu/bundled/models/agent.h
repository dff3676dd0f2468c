/* An estimator agent may be in an FMU, beside its plant: it acts before and after a step. */

#ifndef AGENT_H
#define AGENT_H

#include "core.h"

#if HAS_AGENT

/* Initialisation ends: the estimate and the plant are at their starts. */
void agent_start(Instance *self);

/* A step to `end` begins: at a sampling time t_k, k >= 1, the estimate jumps, and the plant follows
 * it from now on. Refuses a step past the next sampling time. */
bool agent_jump(Instance *self, double end);

/* The step has ended at values->time, to which the estimate flows. */
void agent_flow(Instance *self);

#else

static inline void agent_start(Instance *self)
{
    (void)self;
}

static inline bool agent_jump(Instance *self, double end)
{
    (void)self, (void)end;
    return true;
}

static inline void agent_flow(Instance *self)
{
    (void)self;
}

#endif

#endif
