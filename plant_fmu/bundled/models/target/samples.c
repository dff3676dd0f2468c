/* Samples of a target at t_k = k h; each one stays until the next. */

#include <math.h>

#include "model.h"
#include "samples.h"
#include "truths.h"

static const double SLACK = 1e-6; /* of h, that is rounding */

void model_outputs(Values *v)
{
    const double k = floor(v->time / SAMPLING_PERIOD + SLACK);
    const double *sample = samples[k > 0.0 ? (k < SAMPLES - 1 ? (int)k : SAMPLES - 1) : 0];
    for (int i = 0; i < M; ++i) {
        v->position[i] = sample[i];
        v->velocity[i] = sample[M + i];
#ifdef ACCELERATED
        v->acceleration[i] = sample[2 * M + i];
#endif
    }
}
