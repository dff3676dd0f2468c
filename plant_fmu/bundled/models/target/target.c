/* position = offset + rate t + sum of amplitude sin(frequency t + phase), and its derivative. */

#include "mathematics.h"
#include "model.h"
#include "summation.h"
#include "truths.h"

void model_outputs(Values *v)
{
    for (int i = 0; i < M; ++i) {
        double swing[TERMS], speed[TERMS];
#ifdef ACCELERATED
        double pull[TERMS];
#endif
        for (int k = 0; k < TERMS; ++k) {
            double s, c;
            sine_and_cosine(v->frequency[i][k] * v->time + v->phase[i][k], &s, &c);
            swing[k] = v->amplitude[i][k] * s;
            speed[k] = v->amplitude[i][k] * v->frequency[i][k] * c;
#ifdef ACCELERATED
            pull[k] = v->amplitude[i][k] * v->frequency[i][k] * v->frequency[i][k] * s;
#endif
        }
        v->position[i] = v->offset[i] + v->rate[i] * v->time + sum_pairwise(swing, TERMS);
        v->velocity[i] = v->rate[i] + sum_pairwise(speed, TERMS);
#ifdef ACCELERATED
        v->acceleration[i] = -sum_pairwise(pull, TERMS);
#endif
    }
}
