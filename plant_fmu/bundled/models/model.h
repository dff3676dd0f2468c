/* What the core asks of a model.
 *
 * Values (generated from the declaration) holds every variable at values->time.
 * A model keeps nothing elsewhere. Vectors of states hold states_in(values) numbers. */

#ifndef MODEL_H
#define MODEL_H

#include "variables.h"

/* dx/dt at (t, x); inputs and parameters come from values. */
void model_derivatives(const Values *values, double t, const double x[STATES],
                       double dx[STATES]);

/* Brings outputs up to values->time; calling it again changes nothing. The core calls it
 * before it reads one. */
void model_outputs(Values *values);

/* Brings locals up to the parameters, of which some have changed. */
void model_locals(Values *values);

#endif
