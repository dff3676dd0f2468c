/* What an FMU state holds is all of an instance. Bytes come from outside: they are taken only if
 * an instance could have come to them, and what can be calculated is calculated again. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core.h"
#include "model.h"

static bool is_ours(const Instance *self, const State *state)
{
    if (memcmp(state->token, INSTANTIATION_TOKEN, sizeof state->token) != 0)
        return core_refuse(self, "the state is not one of this FMU");
    if (state->kind != self->state.kind)
        return core_refuse(self, "the state is of the other kind, model exchange or co-simulation");
    return true;
}

/* Whether an instance of this kind can come to have these numbers, and nothing else is in them. */
static bool is_sound(const Instance *self, const State *state)
{
    const int modes = BEFORE_START | TERMINATED | (STRUCTURAL_PARAMETERS ? CONFIGURATION : NEVER) |
                      (state->kind == CO_SIMULATION ? STEP : EVENT | CONTINUOUS_TIME);
    const int mode = (int)state->mode;
    if (mode <= 0 || (mode & (mode - 1)) || !(mode & modes))
        return core_refuse(self, "the state has the mode %d", mode);
    const double steps[] = {state->pace.step, state->pace.after_jump};
    for (int i = 0; i < 2; ++i)
        if (!(isfinite(steps[i]) && steps[i] >= 0.0))
            return core_refuse(self, "the state has an internal step of %g s", steps[i]);
    if (state->jumped & ~1 || state->pace.is_stiff & ~1)
        return core_refuse(self, "the state has marks that are neither 0 nor 1");
    if (!integrator_is_known(self, &state->values))
        return false;
    if (!isfinite(state->values.time) || isnan(state->stop))
        return core_refuse(self, "the state has the time %g and the stop time %g",
                           state->values.time, state->stop);
    const double *numbers = (const double *)&state->values;
    for (int i = 0; i < VALUES; ++i) {
        const Variable *variable = &variables[i];
        if (variable->most && !(numbers[i] >= 1.0 && numbers[i] <= variable->most &&
                                numbers[i] == floor(numbers[i])))
            return core_refuse(self, "the state has %s = %g", variable->name, numbers[i]);
        if (variable->settable_in && !core_is_within_limits(self, variable, numbers[i]))
            return false;
    }
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
    return core_expect(self, ANY_MODE, "getting the state") && core_given(self, state, 1) &&
           store(self, &self->state, state);
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

bool core_free_state(Instance *self, void **state)
{
    if (!core_given(self, state, 1))
        return false;
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
    if (!core_given(self, bytes, size))
        return false;
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
    if (!core_given(self, bytes, size) || !core_given(self, state, 1))
        return false;
    memcpy(&copy, bytes, sizeof copy);
    if (!is_ours(self, &copy) || !is_sound(self, &copy))
        return false;
    copy.derivatives_are_current = false; /* what can be calculated is not taken on trust */
    model_locals(&copy.values);
    return store(self, &copy, state);
}
