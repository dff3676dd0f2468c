/* FMI 3.0 in terms of the core: a value reference names a whole array. */

#include "fmi3Functions.h"

#define FMI(name) fmi3##name
#include "fmi.h"

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

static fmi3Instance none(fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
                         const char *why)
{
    if (log)
        log(environment, fmi3Error, "logStatusError", why);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback log)
{
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
    if (event_mode || n_required > 0)
        return none(environment, log,
                    "this FMU has no event mode and no intermediate update in co-simulation");
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
    return none(environment, log, "this FMU has no scheduled execution");
}

CALL(EnterInitializationMode,
     (void *self, bool tolerance_defined, double tolerance, double start, bool stop_defined,
      double stop),
     core_start_at(self, tolerance_defined, tolerance, start, stop_defined, stop) &&
         core_enter_initialization(self))
CALL(EnterEventMode, (void *self),
     core_accept_time(self, CONTINUOUS_TIME, "entering event mode") &&
         core_change_mode(self, CONTINUOUS_TIME, EVENT, "entering event mode"))
MODE(ExitConfigurationMode, CONFIGURATION, INSTANTIATED, "leaving configuration mode")

fmi3Status fmi3EnterConfigurationMode(fmi3Instance self)
{
    if (STRUCTURAL_PARAMETERS == 0)
        return unsupported(self, "structural parameters");
    return status(
        core_change_mode(self, INSTANTIATED, CONFIGURATION, "entering configuration mode"));
}

/* Variables */

CALL(GetFloat64, (void *self, References of, size_t n, double values[], size_t n_values),
     core_get(self, of, n, values, n_values))
CALL(SetFloat64, (void *self, References of, size_t n, const double values[], size_t n_values),
     core_set(self, of, n, values, n_values))
CALL(GetUInt64, (void *self, References of, size_t n, uint64_t values[], size_t n_values),
     core_get_counts(self, of, n, values, n_values))
CALL(SetUInt64, (void *self, References of, size_t n, const uint64_t values[], size_t n_values),
     core_set_counts(self, of, n, values, n_values))

#define NO_VARIABLES_OF(type)                                                                      \
    NO("variables of type " #type, Get##type,                                                      \
       (void *self, References of, size_t n, fmi3##type values[], size_t n_values))                \
    NO("variables of type " #type, Set##type,                                                      \
       (void *self, References of, size_t n, const fmi3##type values[], size_t n_values))

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
NO("variables of type Binary", GetBinary,
   (void *self, References of, size_t n, size_t sizes[], fmi3Binary values[], size_t n_values))
NO("variables of type Binary", SetBinary,
   (void *self, References of, size_t n, const size_t sizes[], const fmi3Binary values[],
    size_t n_values))

/* State */

CALL(GetFMUState, (void *self, void **state), core_get_state(self, state))
CALL(SetFMUState, (void *self, void *state), core_set_state(self, state))
CALL(FreeFMUState, (void *self, void **state), core_free_state(self, state))
CALL(SerializedFMUStateSize, (void *self, void *state, size_t *size), size_of_state(self, size))
CALL(SerializeFMUState, (void *self, void *state, fmi3Byte bytes[], size_t size),
     core_serialize(self, state, bytes, size))
CALL(DeserializeFMUState, (void *self, const fmi3Byte bytes[], size_t size, void **state),
     core_deserialize(self, bytes, size, state))

static bool all_given(void *self, size_t n, const void *const places[])
{
    for (size_t i = 0; i < n; ++i)
        if (!core_given(self, places[i], 1))
            return false;
    return true;
}

/* Model exchange */

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance self, fmi3Boolean *need_update,
                                    fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
                                    fmi3Boolean *states_changed, fmi3Boolean *next_event_defined,
                                    fmi3Float64 *next_event)
{
    const void *const places[] = {need_update,    terminate,          nominals_changed,
                                  states_changed, next_event_defined, next_event};
    if (!all_given(self, sizeof places / sizeof *places, places))
        return fmi3Error;
    *need_update = *terminate = *nominals_changed = *states_changed = *next_event_defined = false;
    *next_event = 0.0;
    return status(core_expect(self, EVENT, "updating discrete states"));
}

CALL(GetContinuousStateDerivatives, (void *self, double dx[], size_t n),
     core_get_derivatives(self, dx, n))

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance self, size_t *n)
{
    if (!core_expect(self, ANY_MODE, "asking for the number of states") ||
        !core_given(self, n, 1))
        return fmi3Error;
    *n = (size_t)states_in(&((Instance *)self)->state.values);
    return fmi3OK;
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance self, size_t *n)
{
    if (!core_given(self, n, 1))
        return fmi3Error;
    *n = 0;
    return status(core_expect(self, ANY_MODE, "asking for the number of event indicators"));
}

/* Co-simulation */

fmi3Status fmi3DoStep(fmi3Instance self, fmi3Float64 time, fmi3Float64 step,
                      fmi3Boolean no_set_prior, fmi3Boolean *event_handling_needed,
                      fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_successful_time)
{
    const void *const places[] = {event_handling_needed, terminate, early_return,
                                  last_successful_time};
    if (!all_given(self, sizeof places / sizeof *places, places))
        return fmi3Error;
    *event_handling_needed = *terminate = *early_return = false;
    const bool done = core_step(self, time, step);
    if (self)
        *last_successful_time = ((Instance *)self)->state.values.time;
    return status(done);
}

/* What these FMUs do not have */

typedef fmi3IntervalQualifier Qualifier;

NO("event mode in co-simulation", EnterStepMode, (void *self))
NO("output derivatives", GetOutputDerivatives,
   (void *self, References of, size_t n, const int32_t orders[], double values[], size_t n_values))
NO("discrete states", EvaluateDiscreteStates, (void *self))
NO("per-element dependencies", GetNumberOfVariableDependencies,
   (void *self, unsigned dependent, size_t *n))
NO("per-element dependencies", GetVariableDependencies,
   (void *self, unsigned dependent, size_t elements[], unsigned independents[],
    size_t independent_elements[], fmi3DependencyKind kinds[], size_t n))
NO("directional derivatives", GetDirectionalDerivative,
   (void *self, References unknowns, size_t n_unknowns, References knowns, size_t n_knowns,
    const double seed[], size_t n_seed, double sensitivity[], size_t n_sensitivity))
NO("adjoint derivatives", GetAdjointDerivative,
   (void *self, References unknowns, size_t n_unknowns, References knowns, size_t n_knowns,
    const double seed[], size_t n_seed, double sensitivity[], size_t n_sensitivity))
NO("clocks", GetClock, (void *self, References of, size_t n, fmi3Clock values[]))
NO("clocks", SetClock, (void *self, References of, size_t n, const fmi3Clock values[]))
NO("clocks", GetIntervalDecimal,
   (void *self, References of, size_t n, double intervals[], Qualifier qualifiers[]))
NO("clocks", GetIntervalFraction,
   (void *self, References of, size_t n, uint64_t counters[], uint64_t resolutions[],
    Qualifier qualifiers[]))
NO("clocks", GetShiftDecimal, (void *self, References of, size_t n, double shifts[]))
NO("clocks", GetShiftFraction,
   (void *self, References of, size_t n, uint64_t counters[], uint64_t resolutions[]))
NO("clocks", SetIntervalDecimal,
   (void *self, References of, size_t n, const double intervals[]))
NO("clocks", SetIntervalFraction,
   (void *self, References of, size_t n, const uint64_t counters[], const uint64_t resolutions[]))
NO("clocks", SetShiftDecimal, (void *self, References of, size_t n, const double shifts[]))
NO("clocks", SetShiftFraction,
   (void *self, References of, size_t n, const uint64_t counters[], const uint64_t resolutions[]))
NO("clocks", ActivateModelPartition, (void *self, unsigned clock, double time))
