/* Steps from one time to the next, each as long as the error control allows. */

#ifndef INTEGRATOR_H
#define INTEGRATOR_H

#include <stdbool.h>

#include "variables.h"

typedef enum { REACHED, NOT_FINITE, STEP_UNDERFLOW, TOO_MANY_STEPS } Outcome;

/* What the error control would take next, s; 0 before there was any. Hand it from one
 * interval to the next, in the FMU state, and a restored state continues with the same bits. */
typedef struct {
    double step;
    double after_jump; /* where the right-hand side has just jumped */
    int is_stiff;      /* 1 once stability alone has made steps short */
} Pace;

/* One step of a method, from x with derivatives dx at t to y with dy at t_next = t + h. */
typedef struct {
    const Values *values;
    double t, h, t_next;
    double x[STATES], dx[STATES], y[STATES], dy[STATES];
    double rate; /* 1/s: of the fastest decay, as far as the method has seen any; else 0 */
} Step;

/* A method tries a step. The error is in units of the tolerance; dy need not be there of
 * one that is over 1, and one that is not finite is NaN. */
typedef struct {
    double (*attempt)(Step *step);
    double (*inverse_root)(double error); /* error^(-1/p), where it grows with h^p */
    double first_node; /* the least part of a step between two right-hand sides */
} Method;

extern const Method dormand_prince, dop853, implicit_euler;

static inline double larger(double a, double b)
{
    return a > b ? a : b;
}

static inline double smaller(double a, double b)
{
    return a < b ? a : b;
}

/* 1 + max(|a|, |b|): errors are relative to it. */
double scale(double a, double b);

/* Advances values->time, the states and their derivatives (which must be current)
 * to `end`; on any outcome but REACHED, to the last step that was accepted. `jumped` says
 * that the right-hand side has jumped at the beginning. */
Outcome integrate(Values *values, double end, bool jumped, Pace *pace);

#endif
