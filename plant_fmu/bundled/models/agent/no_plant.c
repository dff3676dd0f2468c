/* An agent alone: no plant is beside it, and nothing is integrated. */

#include "plant.h"

#include "model.h"

void plant_start(Values *values)
{
    (void)values;
}

void plant_follow(Instance *self, const double position[M], const double velocity[M],
                  const double *acceleration)
{
    (void)self, (void)position, (void)velocity, (void)acceleration;
}

void plant_lose(Values *values)
{
    (void)values;
}

void model_outputs(Values *values)
{
    (void)values;
}
