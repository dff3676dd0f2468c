/* FMI 3.0 in terms of the core: a value reference names a whole array. */

#include "fmi3Functions.h"

#include <stdio.h>
#include <stdlib.h>

#include "core.h"

typedef struct {
    Instance core; /* first, so that a pointer to it is one to the whole */
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log;
} Component;

static void log_error(const Instance *self, const char *message)
{
    const Component *component = (const Component *)self;
    if (component->log)
        component->log(component->environment, fmi3Error, "logStatusError", message);
}

static fmi3Status status(bool done)
{
    return done ? fmi3OK : fmi3Error;
}

static fmi3Status unsupported(fmi3Instance instance, const char *what)
{
    return status(instance && core_refuse(instance, "this FMU has no %s", what));
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean on, size_t n,
                               const fmi3String categories[])
{
    (void)on, (void)n, (void)categories; /* only errors are logged, and always */
    return status(core_expect(instance, ANY_MODE, "setting the logging"));
}

/* Life */

static fmi3Instance instantiate(Kind kind, fmi3String token, fmi3InstanceEnvironment environment,
                                fmi3LogMessageCallback log)
{
    Component *component = calloc(1, sizeof *component);
    if (!component)
        return NULL;
    component->core.whole_variables = true;
    component->core.log_error = log_error;
    component->environment = environment;
    component->log = log;
    if (core_instantiate(&component->core, kind, token))
        return component;
    free(component);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
    (void)name, (void)resources, (void)visible, (void)logging;
    return instantiate(MODEL_EXCHANGE, token, environment, log);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging,
                                         fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log,
                                         fmi3IntermediateUpdateCallback update)
{
    (void)name, (void)resources, (void)visible, (void)logging, (void)early_return, (void)update;
    (void)required;
    if (event_mode || n_required > 0) {
        if (log)
            log(environment, fmi3Error, "logStatusError",
                "this FMU has no event mode and no intermediate update in co-simulation");
        return NULL;
    }
    return instantiate(CO_SIMULATION, token, environment, log);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token,
                                               fmi3String resources, fmi3Boolean visible,
                                               fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback log,
                                               fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    (void)update, (void)lock, (void)unlock;
    if (log)
        log(environment, fmi3Error, "logStatusError", "this FMU has no scheduled execution");
    return NULL;
}

void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined,
                                       fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean stop_defined, fmi3Float64 stop)
{
    (void)stop_defined, (void)stop;
    return status(core_start_at(instance, tolerance_defined, tolerance, start) &&
                  core_enter_initialization(instance));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    return status(core_exit_initialization(instance));
}

fmi3Status fmi3EnterEventMode(fmi3Instance instance)
{
    return status(core_change_mode(instance, CONTINUOUS_TIME, EVENT, "entering event mode"));
}

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance instance)
{
    return status(core_change_mode(instance, EVENT, CONTINUOUS_TIME,
                                   "entering continuous-time mode"));
}

fmi3Status fmi3EnterStepMode(fmi3Instance instance)
{
    return unsupported(instance, "event mode in co-simulation");
}

fmi3Status fmi3EnterConfigurationMode(fmi3Instance instance)
{
    if (STRUCTURAL_PARAMETERS == 0)
        return unsupported(instance, "structural parameters");
    return status(core_change_mode(instance, INSTANTIATED, CONFIGURATION,
                                   "entering configuration mode"));
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance instance)
{
    return status(core_change_mode(instance, CONFIGURATION, INSTANTIATED,
                                   "leaving configuration mode"));
}

fmi3Status fmi3Terminate(fmi3Instance instance)
{
    return status(core_change_mode(instance, INITIALIZED, TERMINATED, "termination"));
}

fmi3Status fmi3Reset(fmi3Instance instance)
{
    return status(core_reset(instance));
}

/* Variables */

fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[],
                          size_t n_references, fmi3Float64 values[], size_t n_values)
{
    return status(core_get(instance, references, n_references, values, n_values));
}

fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[],
                          size_t n_references, const fmi3Float64 values[], size_t n_values)
{
    return status(core_set(instance, references, n_references, values, n_values));
}

fmi3Status fmi3GetUInt64(fmi3Instance instance, const fmi3ValueReference references[],
                         size_t n_references, fmi3UInt64 values[], size_t n_values)
{
    return status(core_get_counts(instance, references, n_references, values, n_values));
}

fmi3Status fmi3SetUInt64(fmi3Instance instance, const fmi3ValueReference references[],
                         size_t n_references, const fmi3UInt64 values[], size_t n_values)
{
    return status(core_set_counts(instance, references, n_references, values, n_values));
}

#define NO_VARIABLES_OF(type)                                                                      \
    fmi3Status fmi3Get##type(fmi3Instance instance, const fmi3ValueReference references[],         \
                             size_t n_references, fmi3##type values[], size_t n_values)            \
    {                                                                                              \
        (void)references, (void)n_references, (void)values, (void)n_values;                        \
        return unsupported(instance, "variables of type " #type);                                  \
    }                                                                                              \
    fmi3Status fmi3Set##type(fmi3Instance instance, const fmi3ValueReference references[],         \
                             size_t n_references, const fmi3##type values[], size_t n_values)      \
    {                                                                                              \
        (void)references, (void)n_references, (void)values, (void)n_values;                        \
        return unsupported(instance, "variables of type " #type);                                  \
    }

NO_VARIABLES_OF(Float32)
NO_VARIABLES_OF(Int8)
NO_VARIABLES_OF(UInt8)
NO_VARIABLES_OF(Int16)
NO_VARIABLES_OF(UInt16)
NO_VARIABLES_OF(Int32)
NO_VARIABLES_OF(UInt32)
NO_VARIABLES_OF(Int64)
NO_VARIABLES_OF(Boolean)
NO_VARIABLES_OF(String)

fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                         size_t sizes[], fmi3Binary values[], size_t n_values)
{
    (void)references, (void)n, (void)sizes, (void)values, (void)n_values;
    return unsupported(instance, "variables of type Binary");
}

fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                         const size_t sizes[], const fmi3Binary values[], size_t n_values)
{
    (void)references, (void)n, (void)sizes, (void)values, (void)n_values;
    return unsupported(instance, "variables of type Binary");
}

/* State */

fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    return status(core_get_state(instance, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    return status(core_set_state(instance, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    return status(core_free_state(state));
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state, size_t *size)
{
    (void)state;
    *size = sizeof(State);
    return status(core_expect(instance, ANY_MODE, "asking for the size of a state"));
}

fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state, fmi3Byte bytes[],
                                 size_t size)
{
    return status(core_serialize(instance, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[], size_t size,
                                   fmi3FMUState *state)
{
    return status(core_deserialize(instance, bytes, size, state));
}

/* Model exchange */

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *need_update,
                                    fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
                                    fmi3Boolean *states_changed, fmi3Boolean *next_event_defined,
                                    fmi3Float64 *next_event)
{
    *need_update = *terminate = *nominals_changed = *states_changed = *next_event_defined = false;
    *next_event = 0.0;
    return status(core_expect(instance, EVENT, "updating discrete states"));
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance, fmi3Boolean no_set_prior,
                                       fmi3Boolean *enter_event_mode, fmi3Boolean *terminate)
{
    (void)no_set_prior;
    *enter_event_mode = *terminate = false;
    return status(core_expect(instance, CONTINUOUS_TIME, "completing an integrator step"));
}

fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    return status(core_set_time(instance, time));
}

fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 x[], size_t n)
{
    return status(core_set_states(instance, x, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance instance, fmi3Float64 x[], size_t n)
{
    return status(core_get_states(instance, x, n));
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance instance, fmi3Float64 dx[], size_t n)
{
    return status(core_get_derivatives(instance, dx, n));
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance instance, fmi3Float64 nominals[],
                                             size_t n)
{
    return status(core_get_nominals(instance, nominals, n));
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance instance, size_t *n)
{
    if (!core_expect(instance, ANY_MODE, "asking for the number of states"))
        return fmi3Error;
    *n = (size_t)states_in(&((Instance *)instance)->state.values);
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance instance, size_t *n)
{
    *n = 0;
    return status(core_expect(instance, ANY_MODE, "asking for the number of event indicators"));
}

fmi3Status fmi3GetEventIndicators(fmi3Instance instance, fmi3Float64 indicators[], size_t n)
{
    (void)indicators;
    return n == 0 ? fmi3OK : unsupported(instance, "event indicators");
}

/* Co-simulation */

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step,
                      fmi3Boolean no_set_prior, fmi3Boolean *event_handling_needed,
                      fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_successful_time)
{
    (void)no_set_prior;
    *event_handling_needed = *terminate = *early_return = false;
    const bool done = core_step(instance, time, step);
    if (instance)
        *last_successful_time = ((Instance *)instance)->state.values.time;
    return status(done);
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance, const fmi3ValueReference references[],
                                    size_t n, const fmi3Int32 orders[], fmi3Float64 values[],
                                    size_t n_values)
{
    (void)references, (void)n, (void)orders, (void)values, (void)n_values;
    return unsupported(instance, "output derivatives");
}

/* What these FMUs do not have */

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance instance)
{
    return unsupported(instance, "discrete states");
}

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                               size_t *n)
{
    (void)dependent, (void)n;
    return unsupported(instance, "per-element dependencies");
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                       size_t dependent_elements[],
                                       fmi3ValueReference independents[],
                                       size_t independent_elements[], fmi3DependencyKind kinds[],
                                       size_t n)
{
    (void)dependent, (void)dependent_elements, (void)independents, (void)independent_elements;
    (void)kinds, (void)n;
    return unsupported(instance, "per-element dependencies");
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                        size_t n_unknowns, const fmi3ValueReference knowns[],
                                        size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                        fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed;
    (void)sensitivity, (void)n_sensitivity;
    return unsupported(instance, "directional derivatives");
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance instance, const fmi3ValueReference unknowns[],
                                    size_t n_unknowns, const fmi3ValueReference knowns[],
                                    size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
                                    fmi3Float64 sensitivity[], size_t n_sensitivity)
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)n_seed;
    (void)sensitivity, (void)n_sensitivity;
    return unsupported(instance, "adjoint derivatives");
}

fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                        fmi3Clock values[])
{
    (void)references, (void)n, (void)values;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference references[], size_t n,
                        const fmi3Clock values[])
{
    (void)references, (void)n, (void)values;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference references[],
                                  size_t n, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    (void)references, (void)n, (void)intervals, (void)qualifiers;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance instance, const fmi3ValueReference references[],
                                   size_t n, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                   fmi3IntervalQualifier qualifiers[])
{
    (void)references, (void)n, (void)counters, (void)resolutions, (void)qualifiers;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance instance, const fmi3ValueReference references[],
                               size_t n, fmi3Float64 shifts[])
{
    (void)references, (void)n, (void)shifts;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3GetShiftFraction(fmi3Instance instance, const fmi3ValueReference references[],
                                size_t n, fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    (void)references, (void)n, (void)counters, (void)resolutions;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance instance, const fmi3ValueReference references[],
                                  size_t n, const fmi3Float64 intervals[])
{
    (void)references, (void)n, (void)intervals;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance instance, const fmi3ValueReference references[],
                                   size_t n, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[])
{
    (void)references, (void)n, (void)counters, (void)resolutions;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance instance, const fmi3ValueReference references[],
                               size_t n, const fmi3Float64 shifts[])
{
    (void)references, (void)n, (void)shifts;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3SetShiftFraction(fmi3Instance instance, const fmi3ValueReference references[],
                                size_t n, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[])
{
    (void)references, (void)n, (void)counters, (void)resolutions;
    return unsupported(instance, "clocks");
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock,
                                      fmi3Float64 time)
{
    (void)clock, (void)time;
    return unsupported(instance, "clocks");
}
