/* What an agent does to the plant beside it. */

#ifndef PLANT_H
#define PLANT_H

#include "core.h"

/* Brings it to its start. */
void plant_start(Values *values);

/* It follows position + s velocity + s^2/2 acceleration from now on, s being the time since; of no
 * acceleration where that is NULL. */
void plant_follow(Instance *self, const double position[M], const double velocity[M],
                  const double *acceleration);

/* Its outputs mean nothing any more. */
void plant_lose(Values *values);

#endif
