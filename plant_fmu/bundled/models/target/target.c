/* position = offset + rate t + sum of amplitude sin(frequency t + phase), and its derivative. */

#include "mathematics.h"
#include "model.h"
#include "summation.h"

void model_outputs(Values *v)
{
    for (int i = 0; i < M; ++i) {
        double swing[TERMS], speed[TERMS];
        for (int k = 0; k < TERMS; ++k) {
            double s, c;
            sine_and_cosine(v->frequency[i][k] * v->time + v->phase[i][k], &s, &c);
            swing[k] = v->amplitude[i][k] * s;
            speed[k] = v->amplitude[i][k] * v->frequency[i][k] * c;
        }
        v->position[i] = v->offset[i] + v->rate[i] * v->time + sum_pairwise(swing, TERMS);
        v->velocity[i] = v->rate[i] + sum_pairwise(speed, TERMS);
    }
}
