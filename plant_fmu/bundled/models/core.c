/* Time moves only in core_step and core_set_time; a variable changes only by a set that
 * its declaration allows, by time, or by what depends on both. */

#include "core.h"

#include <inttypes.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

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
    memcpy(&state->values, start_values, sizeof state->values);
    model_start(&state->values);
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

bool core_start_at(Instance *self, bool tolerance_defined, double tolerance, double time)
{
    if (!core_expect(self, INSTANTIATED, "setting up the experiment"))
        return false;
    if (!isfinite(time))
        return core_refuse(self, "the start time is %g", time);
    Values *values = &self->state.values;
    if (tolerance_defined)
        values->relative_tolerance = tolerance;
    model_outputs(values);
    values->time = time;
    model_start(values);
    return true;
}

bool core_enter_initialization(Instance *self)
{
    return core_change_mode(self, INSTANTIATED, INITIALIZATION, "entering initialization mode");
}

bool core_exit_initialization(Instance *self)
{
    if (!core_expect(self, INITIALIZATION, "leaving initialization mode"))
        return false;
    const double tolerance = self->state.values.relative_tolerance;
    if (!(tolerance >= 1e-14 && tolerance <= 1.0))
        return core_refuse(self, "relative_tolerance: expected 1e-14 to 1, got %g", tolerance);
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
    double x[STATES], dx[STATES];
    get_states(values, x);
    model_derivatives(values, values->time, x, dx);
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
    if (!core_expect(self, ANY_MODE, "reading a variable"))
        return false;
    State *state = &self->state;
    model_outputs(&state->values);
    for (size_t i = 0; i < n_references; ++i) {
        Block from;
        if (!find(self, references[i], n_values, &from))
            return false;
        if (variables[references[i]].is_derivative)
            update_derivatives(state);
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
        if (!isfinite(values[i]))
            return core_refuse(self, "setting %s to %g", variable->name, values[i]);
    return true;
}

bool core_set(Instance *self, const unsigned references[], size_t n_references,
              const double values[], size_t n_values)
{
    if (!core_expect(self, ANY_MODE, "setting a variable"))
        return false;
    State *state = &self->state;
    model_outputs(&state->values);
    for (size_t i = 0; i < n_references; ++i) {
        Block to;
        if (!find(self, references[i], n_values, &to) ||
            !may_set(self, references[i], values, to.rows * to.columns))
            return false;
        for (size_t row = 0; row < to.rows; ++row, values += to.columns)
            memcpy(to.first + row * to.stride, values, to.columns * sizeof *values);
        model_was_set(&state->values, references[i]);
        state->derivatives_are_current = false;
        n_values -= to.rows * to.columns;
    }
    return used_up(self, n_values);
}

/* Structural parameters */

static bool are_structural(const Instance *self, const unsigned references[],
                           size_t n_references, size_t n_counts)
{
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
    model_start(values);
}

bool core_get_counts(Instance *self, const unsigned references[], size_t n_references,
                     uint64_t counts[], size_t n_counts)
{
    if (!core_expect(self, ANY_MODE, "reading a structural parameter") ||
        !are_structural(self, references, n_references, n_counts))
        return false;
    for (size_t i = 0; i < n_references; ++i)
        counts[i] = (uint64_t)((const double *)&self->state.values)[references[i]];
    return true;
}

bool core_set_counts(Instance *self, const unsigned references[], size_t n_references,
                     const uint64_t counts[], size_t n_counts)
{
    if (!core_expect(self, CONFIGURATION, "setting a structural parameter") ||
        !are_structural(self, references, n_references, n_counts))
        return false;
    Values *values = &self->state.values;
    for (size_t i = 0; i < n_references; ++i) {
        const Variable *variable = &variables[references[i]];
        if (counts[i] < 1 || counts[i] > variable->most)
            return core_refuse(self, "%s: expected 1 to %u, got %" PRIu64, variable->name,
                               variable->most, counts[i]);
        ((double *)values)[references[i]] = (double)counts[i];
        restart_sized_by(values, references[i]);
        self->state.derivatives_are_current = false;
    }
    return true;
}

/* Model exchange */

static bool all_states(const Instance *self, size_t n)
{
    const int expected = states_in(&self->state.values);
    return n == (size_t)expected ||
           core_refuse(self, "expected %d states, got %lu", expected, (unsigned long)n);
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

bool core_set_states(Instance *self, const double x[], size_t n)
{
    if (!core_expect(self, CONTINUOUS_TIME, "setting the states") || !all_states(self, n))
        return false;
    set_states(&self->state.values, x);
    self->state.derivatives_are_current = false;
    return true;
}

bool core_get_states(Instance *self, double x[], size_t n)
{
    if (!core_expect(self, ANY_MODE, "reading the states") || !all_states(self, n))
        return false;
    get_states(&self->state.values, x);
    return true;
}

bool core_get_derivatives(Instance *self, double dx[], size_t n)
{
    if (!core_expect(self, ANY_MODE, "reading the derivatives") || !all_states(self, n))
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
    if (!core_expect(self, ANY_MODE, "reading the nominal values") || !all_states(self, n))
        return false;
    for (size_t i = 0; i < n; ++i)
        nominals[i] = 1.0;
    return true;
}

/* Co-simulation */

bool core_step(Instance *self, double time, double step)
{
    if (!core_expect(self, STEP, "a step"))
        return false;
    State *state = &self->state;
    Values *values = &state->values;
    const double end = time + step;
    if (!(fabs(time - values->time) <= 1e-9 * fmax(1.0, fabs(time))))
        return core_refuse(self, "a step from t = %.17g s, but the instance is at t = %.17g s", time,
                           values->time);
    if (!(isfinite(end) && step > 0.0 && end > values->time))
        return core_refuse(self, "at t = %.17g s: a step of %g s does not advance time", time, step);

    update_derivatives(state);
    switch (dormand_prince(values, end, &state->internal_step)) {
    case REACHED:
        return true;
    case NOT_FINITE:
        return core_refuse(self, "at t = %.17g s: a derivative is not finite", values->time);
    case STEP_UNDERFLOW:
        return core_refuse(self, "at t = %.17g s: no internal step is small enough for "
                           "relative_tolerance = %g", values->time, values->relative_tolerance);
    case TOO_MANY_STEPS:
        return core_refuse(self, "at t = %.17g s: too many internal steps, now of %g s",
                           values->time, state->internal_step);
    }
    return false;
}

/* State */

static bool is_ours(const Instance *self, const State *state)
{
    if (memcmp(state->token, INSTANTIATION_TOKEN, sizeof state->token) != 0)
        return core_refuse(self, "the state is not one of this FMU");
    if (state->kind != self->state.kind)
        return core_refuse(self, "the state is of the other kind, model exchange or co-simulation");
    const double *theirs = (const double *)&state->values;
    const double *ours = (const double *)&self->state.values;
    for (int i = 0; i < VALUES; ++i)
        if (variables[i].most && theirs[i] != ours[i])
            return core_refuse(self, "the state has %s = %g, this instance %g", variables[i].name,
                               theirs[i], ours[i]);
    return true;
}

static bool store(const Instance *self, const void *bytes, void **state)
{
    if (!*state)
        *state = malloc(sizeof(State));
    if (!*state)
        return core_refuse(self, "out of memory");
    memcpy(*state, bytes, sizeof(State));
    return true;
}

bool core_get_state(Instance *self, void **state)
{
    return core_expect(self, ANY_MODE, "getting the state") && store(self, &self->state, state);
}

bool core_set_state(Instance *self, const void *state)
{
    if (!core_expect(self, ANY_MODE, "setting the state"))
        return false;
    if (!state)
        return core_refuse(self, "setting no state");
    if (!is_ours(self, state))
        return false;
    memcpy(&self->state, state, sizeof(State));
    return true;
}

bool core_free_state(void **state)
{
    free(*state);
    *state = NULL;
    return true;
}

bool core_serialize(Instance *self, const void *state, void *bytes, size_t size)
{
    if (!core_expect(self, ANY_MODE, "serializing a state"))
        return false;
    if (!state || size != sizeof(State))
        return core_refuse(self, "serializing %s state of %lu bytes to %lu", state ? "a" : "no",
                           (unsigned long)sizeof(State), (unsigned long)size);
    memcpy(bytes, state, sizeof(State));
    return true;
}

bool core_deserialize(Instance *self, const void *bytes, size_t size, void **state)
{
    State copy;
    if (!core_expect(self, ANY_MODE, "deserializing a state"))
        return false;
    if (size != sizeof copy)
        return core_refuse(self, "a serialized state has %lu bytes, got %lu",
                           (unsigned long)sizeof copy, (unsigned long)size);
    memcpy(&copy, bytes, sizeof copy);
    return is_ours(self, &copy) && store(self, &copy, state);
}
