/* Dormand and Prince's embedded pair of orders 5 and 4, with an adaptive step. */

#ifndef DORMAND_PRINCE_H
#define DORMAND_PRINCE_H

#include "variables.h"

typedef enum { REACHED, NOT_FINITE, STEP_UNDERFLOW, TOO_MANY_STEPS } Outcome;

/* Advances values->time, the states and their derivatives (which must be current)
 * to `end`; on any outcome but REACHED, to the last step that was accepted. *step (s)
 * is what the error control would take next, 0 before the first interval: hand it from
 * one interval to the next, in the FMU state, and a restored state continues with the
 * same bits. */
Outcome dormand_prince(Values *values, double end, double *step);

#endif
