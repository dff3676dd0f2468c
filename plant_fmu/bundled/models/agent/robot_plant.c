/* The plant is the robot of robot.c. */

#include "plant.h"

#include <math.h>

void plant_start(Values *values)
{
    for (int i = 0; i < M; ++i) {
        values->q[i] = values->q_start[i];
        values->qd[i] = values->qd_start[i];
    }
}

void plant_follow(Instance *self, const double position[M], const double velocity[M],
                  const double *acceleration)
{
    Values *values = &self->state.values;
    for (int i = 0; i < M; ++i) {
        values->position_ref[i] = position[i];
        values->velocity_ref[i] = velocity[i];
        if (acceleration)
            values->acceleration_ref[i] = acceleration[i];
    }
    values->reference_time = values->time;
    self->state.derivatives_are_current = false;
}

void plant_lose(Values *values)
{
    for (int i = 0; i < M; ++i)
        values->q[i] = values->qd[i] = NAN;
}
