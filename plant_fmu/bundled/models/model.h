/* What the core asks of a model.
 *
 * Values (generated from the declaration) holds every variable at values->time.
 * A model keeps nothing elsewhere. Vectors of states hold states_in(values) numbers. */

#ifndef MODEL_H
#define MODEL_H

#include <stddef.h>

#include "variables.h"

/* True when number `index` of Values lies in `field`. */
#define IS_PART_OF(index, field)                                                   \
    ((index) - offsetof(Values, field) / sizeof(double) <                          \
     sizeof(((Values *)0)->field) / sizeof(double))

/* dx/dt at (t, x); inputs and parameters come from values. */
void model_derivatives(const Values *values, double t, const double x[STATES],
                       double dx[STATES]);

/* Brings inputs that move by themselves, locals and outputs up to values->time;
 * calling it again changes nothing. The core calls it before every get and set. */
void model_outputs(Values *values);

/* values->time has become the start time. */
void model_start(Values *values);

/* The importer has set the variable to which number `index` of Values belongs. */
void model_was_set(Values *values, size_t index);

#endif
