/* Time moves only in core_step and core_set_time; a variable changes only by a set that
 * its declaration allows, by time, or by what depends on both. */

#include "core.h"

#include <float.h>
#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdio.h>
#include <string.h>

#include "agent.h"
#include "model.h"

static const char *mode_name(Mode mode)
{
    switch (mode) {
    case INSTANTIATED: return "before initialization";
    case INITIALIZATION: return "in initialization mode";
    case EVENT: return "in event mode";
    case CONTINUOUS_TIME: return "in continuous-time mode";
    case STEP: return "in step mode";
    case TERMINATED: return "after termination";
    case CONFIGURATION: return "in configuration mode";
    }
    return "in an unknown mode";
}

bool core_refuse(const Instance *self, const char *format, ...)
{
    char message[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    self->log_error(self, message);
    return false;
}

bool core_given(const Instance *self, const void *place, size_t n)
{
    return place || n == 0 || (self && core_refuse(self, "a pointer that is passed is NULL"));
}

bool core_expect(const Instance *self, int modes, const char *what)
{
    if (!self)
        return false;
    if (self->state.mode & modes)
        return true;
    return core_refuse(self, "%s is not allowed %s", what, mode_name(self->state.mode));
}

/* Life */

static void begin(State *state, Kind kind)
{
    memset(state, 0, sizeof *state); /* padding too: equal states are equal bytes */
    strcpy(state->token, INSTANTIATION_TOKEN);
    state->kind = kind;
    state->mode = INSTANTIATED;
    state->jumped = 1;
    state->stop = INFINITY;
    memcpy(&state->values, start_values, sizeof state->values);
    model_locals(&state->values);
}

bool core_instantiate(Instance *self, Kind kind, const char *token)
{
    if (!token || strcmp(token, INSTANTIATION_TOKEN) != 0)
        return core_refuse(self, "instantiation with the token of another FMU: this binary's is %s",
                           INSTANTIATION_TOKEN);
    begin(&self->state, kind);
    return true;
}

bool core_reset(Instance *self)
{
    if (!core_expect(self, ANY_MODE, "a reset"))
        return false;
    begin(&self->state, self->state.kind);
    return true;
}

bool core_is_within_limits(const Instance *self, const Variable *variable, double value)
{
    if (!isfinite(value))
        return core_refuse(self, "setting %s to %g", variable->name, value);
    return (value >= variable->min && value <= variable->max) ||
           core_refuse(self, "%s: expected %g to %g, got %g", variable->name, variable->min,
                       variable->max, value);
}

bool core_start_at(Instance *self, bool tolerance_defined, double tolerance, double start,
                   bool stop_defined, double stop)
{
    if (!core_expect(self, INSTANTIATED, "setting up the experiment"))
        return false;
    if (!isfinite(start))
        return core_refuse(self, "the start time is %g", start);
    if (stop_defined && !(stop >= start))
        return core_refuse(self, "the stop time is %.17g s, the start time %.17g s", stop, start);
    Values *values = &self->state.values;
    if (tolerance_defined) {
        const size_t index = offsetof(Values, relative_tolerance) / sizeof(double);
        if (!core_is_within_limits(self, &variables[index], tolerance))
            return false;
        values->relative_tolerance = tolerance;
    }
    values->time = start;
    self->state.stop = stop_defined ? stop : INFINITY;
    return true;
}

/* An importer that adds up time arrives at its stop time but for rounding. */
static bool is_past(double time, double stop)
{
    return time > stop + 1e-9 * larger(1.0, fabs(stop));
}

bool core_enter_initialization(Instance *self)
{
    return core_change_mode(self, INSTANTIATED, INITIALIZATION, "entering initialization mode");
}

bool core_exit_initialization(Instance *self)
{
    if (!core_expect(self, INITIALIZATION, "leaving initialization mode"))
        return false;
    if (!integrator_is_known(self, &self->state.values))
        return false;
    const Values *values = &self->state.values;
    if (self->state.kind == MODEL_EXCHANGE && states_in(values) > exchanged_states_in(values))
        return core_refuse(self, "ki: integral action is of co-simulation alone");
    agent_start(self);
    self->state.mode = self->state.kind == CO_SIMULATION ? STEP : EVENT;
    return true;
}

bool core_change_mode(Instance *self, int from, Mode to, const char *what)
{
    if (!core_expect(self, from, what))
        return false;
    self->state.mode = to;
    return true;
}

/* Variables */

static void update_derivatives(State *state)
{
    Values *values = &state->values;
    if (state->derivatives_are_current)
        return;
    double x[STATES], before[STATES], dx[STATES];
    get_states(values, x);
    get_derivatives(values, before);
    model_derivatives(values, values->time, x, dx);
    for (int i = 0; i < states_in(values); ++i)
        state->jumped |= dx[i] != before[i];
    set_derivatives(values, dx);
    state->derivatives_are_current = true;
}

static size_t number(const Values *values, Length length)
{
    return length.by ? (size_t)((const double *)values)[length.by] : length.most;
}

/* What a value reference names: rows of adjacent numbers, which begin `stride` apart. */
typedef struct {
    double *first;
    size_t rows, columns, stride;
} Block;

static Block block_of(Instance *self, unsigned reference)
{
    if (reference >= VALUES)
        return (Block){NULL, 0, 0, 0};
    Values *values = &self->state.values;
    double *first = (double *)values + reference;
    if (!self->whole_variables)
        return (Block){first, 1, 1, 1};
    const Length rows = variables[reference].rows, columns = variables[reference].columns;
    return (Block){first, number(values, rows), number(values, columns), columns.most};
}

/* Finds the block; refuses when there is none, or no `room` for it in the caller's array. */
static bool find(Instance *self, unsigned reference, size_t room, Block *found)
{
    *found = block_of(self, reference);
    const size_t size = found->rows * found->columns;
    if (size == 0)
        return core_refuse(self, "no variable has the value reference %u", reference);
    return size <= room ||
           core_refuse(self, "too few values: %s has %lu, %lu are left", variables[reference].name,
                       (unsigned long)size, (unsigned long)room);
}

static bool used_up(const Instance *self, size_t room)
{
    return room == 0 ||
           core_refuse(self, "%lu values more than the variables have", (unsigned long)room);
}

bool core_get(Instance *self, const unsigned references[], size_t n_references, double values[],
              size_t n_values)
{
    if (!core_expect(self, ANY_MODE, "reading a variable") ||
        !core_given(self, references, n_references) || !core_given(self, values, n_values))
        return false;
    State *state = &self->state;
    bool outputs_are_current = false;
    for (size_t i = 0; i < n_references; ++i) {
        Block from;
        if (!find(self, references[i], n_values, &from))
            return false;
        const Calculated calculated = variables[references[i]].calculated;
        if (calculated == DERIVATIVE)
            update_derivatives(state);
        if (calculated == OUTPUT && !outputs_are_current)
            model_outputs(&state->values);
        outputs_are_current |= calculated == OUTPUT;
        for (size_t row = 0; row < from.rows; ++row, values += from.columns)
            memcpy(values, from.first + row * from.stride, from.columns * sizeof *values);
        n_values -= from.rows * from.columns;
    }
    return used_up(self, n_values);
}

static bool may_set(const Instance *self, unsigned reference, const double values[], size_t size)
{
    const Variable *variable = &variables[reference];
    if (!(variable->settable_in & self->state.mode))
        return core_refuse(self, "setting %s is not allowed %s", variable->name,
                           mode_name(self->state.mode));
    for (size_t i = 0; i < size; ++i)
        if (!core_is_within_limits(self, variable, values[i]))
            return false;
    return true;
}

/* Looks at all before anything is written, so that a call that is refused leaves no trace. */
static bool may_set_all(Instance *self, const unsigned references[], size_t n_references,
                        const double values[], size_t n_values)
{
    for (size_t i = 0; i < n_references; ++i) {
        Block to;
        if (!find(self, references[i], n_values, &to))
            return false;
        const size_t size = to.rows * to.columns;
        if (!may_set(self, references[i], values, size))
            return false;
        values += size;
        n_values -= size;
    }
    return used_up(self, n_values);
}

bool core_set(Instance *self, const unsigned references[], size_t n_references,
              const double values[], size_t n_values)
{
    if (!core_expect(self, ANY_MODE, "setting a variable") ||
        !core_given(self, references, n_references) || !core_given(self, values, n_values) ||
        !may_set_all(self, references, n_references, values, n_values))
        return false;
    bool before_start = false;
    for (size_t i = 0; i < n_references; ++i) {
        const Block to = block_of(self, references[i]);
        for (size_t row = 0; row < to.rows; ++row, values += to.columns)
            memcpy(to.first + row * to.stride, values, to.columns * sizeof *values);
        before_start |= variables[references[i]].settable_in == BEFORE_START;
    }
    if (before_start)
        model_locals(&self->state.values);
    self->state.derivatives_are_current = false;
    return true;
}

/* Structural parameters */

static bool are_structural(const Instance *self, const unsigned references[],
                           size_t n_references, const uint64_t counts[], size_t n_counts)
{
    if (!core_given(self, references, n_references) || !core_given(self, counts, n_counts))
        return false;
    for (size_t i = 0; i < n_references; ++i)
        if (references[i] >= VALUES || variables[references[i]].most == 0)
            return core_refuse(self, "no structural parameter has the value reference %u",
                               references[i]);
    return n_references == n_counts ||
           core_refuse(self, "%lu values for %lu structural parameters", (unsigned long)n_counts,
                       (unsigned long)n_references);
}

static void restart_sized_by(Values *values, unsigned reference)
{
    for (unsigned i = 0; i < VALUES; ++i) {
        const Length rows = variables[i].rows, columns = variables[i].columns;
        if (rows.by == reference || columns.by == reference)
            memcpy((double *)values + i, start_values + i,
                   rows.most * columns.most * sizeof *start_values);
    }
    model_locals(values);
}

bool core_get_counts(Instance *self, const unsigned references[], size_t n_references,
                     uint64_t counts[], size_t n_counts)
{
    if (!core_expect(self, ANY_MODE, "reading a structural parameter") ||
        !are_structural(self, references, n_references, counts, n_counts))
        return false;
    for (size_t i = 0; i < n_references; ++i)
        counts[i] = (uint64_t)((const double *)&self->state.values)[references[i]];
    return true;
}

bool core_set_counts(Instance *self, const unsigned references[], size_t n_references,
                     const uint64_t counts[], size_t n_counts)
{
    if (!core_expect(self, CONFIGURATION, "setting a structural parameter") ||
        !are_structural(self, references, n_references, counts, n_counts))
        return false;
    for (size_t i = 0; i < n_references; ++i) {
        const Variable *variable = &variables[references[i]];
        if (counts[i] < 1 || counts[i] > variable->most)
            return core_refuse(self, "%s: expected 1 to %u, got %" PRIu64, variable->name,
                               variable->most, counts[i]);
    }
    Values *values = &self->state.values;
    for (size_t i = 0; i < n_references; ++i) {
        double *count = (double *)values + references[i];
        if (*count == (double)counts[i])
            continue;
        *count = (double)counts[i];
        restart_sized_by(values, references[i]);
        self->state.derivatives_are_current = false;
    }
    return true;
}

/* Model exchange */

static bool all_states(const Instance *self, const double x[], size_t n)
{
    const int expected = states_in(&self->state.values);
    if (n != (size_t)expected)
        return core_refuse(self, "expected %d states, got %lu", expected, (unsigned long)n);
    return core_given(self, x, n);
}

bool core_set_time(Instance *self, double time)
{
    if (!core_expect(self, EVENT | CONTINUOUS_TIME, "setting the time"))
        return false;
    if (!isfinite(time))
        return core_refuse(self, "setting the time to %g", time);
    self->state.values.time = time;
    self->state.derivatives_are_current = false;
    return true;
}

/* A solver may look beyond the stop time, as FMPy's does, to interpolate; but not go there. */
bool core_accept_time(Instance *self, int modes, const char *what)
{
    if (!core_expect(self, modes, what))
        return false;
    const double time = self->state.values.time;
    return !is_past(time, self->state.stop) ||
           core_refuse(self, "%s at t = %.17g s, past the stop time %.17g s", what, time,
                       self->state.stop);
}

bool core_set_states(Instance *self, const double x[], size_t n)
{
    if (!core_expect(self, CONTINUOUS_TIME, "setting the states") || !all_states(self, x, n))
        return false;
    for (size_t i = 0; i < n; ++i)
        if (!isfinite(x[i]))
            return core_refuse(self, "setting state %lu of %lu to %g", (unsigned long)i + 1,
                               (unsigned long)n, x[i]);
    set_states(&self->state.values, x);
    self->state.derivatives_are_current = false;
    return true;
}

bool core_get_states(Instance *self, double x[], size_t n)
{
    if (!core_expect(self, ANY_MODE, "reading the states") || !all_states(self, x, n))
        return false;
    get_states(&self->state.values, x);
    return true;
}

bool core_get_derivatives(Instance *self, double dx[], size_t n)
{
    if (!core_expect(self, ANY_MODE, "reading the derivatives") || !all_states(self, dx, n))
        return false;
    update_derivatives(&self->state);
    get_derivatives(&self->state.values, dx);
    for (size_t i = 0; i < n; ++i)
        if (!isfinite(dx[i]))
            return core_refuse(self, "at t = %.17g s: derivative %lu of %lu is %g",
                               self->state.values.time, (unsigned long)i + 1, (unsigned long)n,
                               dx[i]);
    return true;
}

bool core_get_nominals(Instance *self, double nominals[], size_t n)
{
    if (!core_expect(self, ANY_MODE, "reading the nominal values") ||
        !all_states(self, nominals, n))
        return false;
    for (size_t i = 0; i < n; ++i)
        nominals[i] = 1.0;
    return true;
}

/* Co-simulation */

double snapped(double seconds, double size)
{
    const double whole = round(seconds * 1e9) / 1e9;
    return fabs(whole - seconds) <= 8.0 * DBL_EPSILON * size ? whole : seconds;
}

bool core_step(Instance *self, double time, double step)
{
    if (!core_expect(self, STEP, "a step"))
        return false;
    State *state = &self->state;
    Values *values = &state->values;
    const double size = fabs(values->time) + fabs(step);
    const double end = snapped(values->time, size) + snapped(step, size);
    if (!(fabs(time - values->time) <= 1e-9 * larger(1.0, fabs(time))))
        return core_refuse(self, "a step from t = %.17g s, but the instance is at t = %.17g s", time,
                           values->time);
    if (!(isfinite(end) && step > 0.0 && end > values->time))
        return core_refuse(self, "at t = %.17g s: a step of %g s does not advance time", time, step);
    if (is_past(end, state->stop))
        return core_refuse(self, "a step to t = %.17g s, past the stop time %.17g s", end,
                           state->stop);

    if (!agent_jump(self, end))
        return false;
    update_derivatives(state);
    const bool jumped = state->jumped;
    state->jumped = 0;
    switch (integrate(values, end, jumped, &state->pace)) {
    case REACHED:
        agent_flow(self);
        return true;
    case NOT_FINITE:
        return core_refuse(self, "at t = %.17g s: a derivative is not finite", values->time);
    case STEP_UNDERFLOW:
        return core_refuse(self, "at t = %.17g s: no internal step is small enough for "
                           "relative_tolerance = %g", values->time, values->relative_tolerance);
    case TOO_MANY_STEPS:
        return core_refuse(self, "at t = %.17g s: too many internal steps, now of %g s",
                           values->time, state->pace.step);
    }
    return false;
}
