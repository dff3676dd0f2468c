/* Nothing is integrated: time alone goes on. */

#include "core.h"
#include "model.h"

bool integrator_is_known(const Instance *self, const Values *values)
{
    (void)self, (void)values;
    return true;
}

Outcome integrate(Values *values, double end, bool jumped, Pace *pace)
{
    (void)jumped, (void)pace;
    values->time = snapped(end, end);
    return REACHED;
}

void model_derivatives(const Values *values, double t, const double x[STATES], double dx[STATES])
{
    (void)values, (void)t, (void)x, (void)dx;
}

void model_locals(Values *values)
{
    (void)values;
}
