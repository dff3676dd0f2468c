/* FMI 2.0 in terms of the core: a value reference names one number. */

#include "fmi2Functions.h"

#define FMI(name) fmi2##name
#include "fmi.h"

typedef struct {
    Instance core; /* first, so that a pointer to it is one to the whole */
    char name[128];
    fmi2ComponentEnvironment environment;
    fmi2CallbackLogger log;
} Component;

static void log_error(const Instance *self, const char *message)
{
    const Component *component = (const Component *)self;
    if (component->log)
        component->log(component->environment, component->name, fmi2Error, "logStatusError",
                       message);
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

/* Life */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    Component *component = calloc(1, sizeof *component);
    if (!component)
        return NULL;
    component->core.log_error = log_error;
    snprintf(component->name, sizeof component->name, "%s", name ? name : "");
    if (functions) {
        component->environment = functions->componentEnvironment;
        component->log = functions->logger;
    }
    if (core_instantiate(&component->core,
                         type == fmi2CoSimulation ? CO_SIMULATION : MODEL_EXCHANGE, guid))
        return component;
    free(component);
    return NULL;
}

CALL(SetupExperiment,
     (void *self, int tolerance_defined, double tolerance, double start, int stop_defined,
      double stop),
     core_start_at(self, tolerance_defined, tolerance, start, stop_defined, stop))
CALL(EnterInitializationMode, (void *self), core_enter_initialization(self))
CALL(EnterEventMode, (void *self),
     core_accept_time(self, EVENT | CONTINUOUS_TIME, "entering event mode") &&
         core_change_mode(self, EVENT | CONTINUOUS_TIME, EVENT, "entering event mode"))

/* Variables */

CALL(GetReal, (void *self, References of, size_t n, double values[]),
     core_get(self, of, n, values, n))
CALL(SetReal, (void *self, References of, size_t n, const double values[]),
     core_set(self, of, n, values, n))

#define NO_VARIABLES_OF(type)                                                                      \
    NO("variables of type " #type, Get##type,                                                      \
       (void *self, References of, size_t n, fmi2##type values[]))                                 \
    NO("variables of type " #type, Set##type,                                                      \
       (void *self, References of, size_t n, const fmi2##type values[]))

NO_VARIABLES_OF(Integer)
NO_VARIABLES_OF(Boolean)
NO_VARIABLES_OF(String)

/* State */

CALL(GetFMUstate, (void *self, void **state), core_get_state(self, state))
CALL(SetFMUstate, (void *self, void *state), core_set_state(self, state))
CALL(FreeFMUstate, (void *self, void **state), core_free_state(self, state))
CALL(SerializedFMUstateSize, (void *self, void *state, size_t *size), size_of_state(self, size))
CALL(SerializeFMUstate, (void *self, void *state, fmi2Byte bytes[], size_t size),
     core_serialize(self, state, bytes, size))
CALL(DeSerializeFMUstate, (void *self, const fmi2Byte bytes[], size_t size, void **state),
     core_deserialize(self, bytes, size, state))

/* Model exchange */

fmi2Status fmi2NewDiscreteStates(fmi2Component self, fmi2EventInfo *info)
{
    if (!core_given(self, info, 1))
        return fmi2Error;
    *info = (fmi2EventInfo){.newDiscreteStatesNeeded = fmi2False};
    return status(core_expect(self, EVENT, "updating discrete states"));
}

CALL(GetDerivatives, (void *self, double dx[], size_t n), core_get_derivatives(self, dx, n))

/* Co-simulation */

CALL(DoStep, (void *self, double time, double step, int no_set_prior),
     core_step(self, time, step))

fmi2Status fmi2GetRealStatus(fmi2Component self, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime)
        return unsupported(self, "such status of type Real");
    if (!core_expect(self, STEP, "asking for the last successful time") ||
        !core_given(self, value, 1))
        return fmi2Error;
    *value = ((Instance *)self)->state.values.time;
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component self, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (kind != fmi2Terminated)
        return unsupported(self, "such status of type Boolean");
    if (!core_given(self, value, 1))
        return fmi2Error;
    *value = fmi2False;
    return status(core_expect(self, ANY_MODE, "asking for termination"));
}

/* What these FMUs do not have */

NO("asynchronous steps", CancelStep, (void *self))
NO("asynchronous steps", GetStatus, (void *self, fmi2StatusKind kind, fmi2Status *value))
NO("status of type Integer", GetIntegerStatus, (void *self, fmi2StatusKind kind, int *value))
NO("status of type String", GetStringStatus, (void *self, fmi2StatusKind kind, fmi2String *value))
NO("input derivatives", SetRealInputDerivatives,
   (void *self, References of, size_t n, const int orders[], const double values[]))
NO("output derivatives", GetRealOutputDerivatives,
   (void *self, References of, size_t n, const int orders[], double values[]))
NO("directional derivatives", GetDirectionalDerivative,
   (void *self, References unknowns, size_t n_unknowns, References knowns, size_t n_knowns,
    const double seed[], double sensitivity[]))
