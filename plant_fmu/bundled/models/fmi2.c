/* FMI 2.0 in terms of the core: a value reference names one number. */

#include "fmi2Functions.h"

#include <stdio.h>
#include <stdlib.h>

#include "core.h"

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

static fmi2Status status(bool done)
{
    return done ? fmi2OK : fmi2Error;
}

static fmi2Status unsupported(fmi2Component component, const char *what)
{
    return status(component && core_refuse(component, "this FMU has no %s", what));
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component component, fmi2Boolean on, size_t n,
                               const fmi2String categories[])
{
    (void)on, (void)n, (void)categories; /* only errors are logged, and always */
    return status(core_expect(component, ANY_MODE, "setting the logging"));
}

/* Life */

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid,
                              fmi2String resources, const fmi2CallbackFunctions *functions,
                              fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
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

void fmi2FreeInstance(fmi2Component component)
{
    free(component);
}

fmi2Status fmi2SetupExperiment(fmi2Component component, fmi2Boolean tolerance_defined,
                               fmi2Real tolerance, fmi2Real start, fmi2Boolean stop_defined,
                               fmi2Real stop)
{
    (void)stop_defined, (void)stop;
    return status(core_start_at(component, tolerance_defined, tolerance, start));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component component)
{
    return status(core_enter_initialization(component));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component component)
{
    return status(core_exit_initialization(component));
}

fmi2Status fmi2EnterEventMode(fmi2Component component)
{
    return status(core_change_mode(component, EVENT | CONTINUOUS_TIME, EVENT,
                                   "entering event mode"));
}

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component component)
{
    return status(core_change_mode(component, EVENT, CONTINUOUS_TIME,
                                   "entering continuous-time mode"));
}

fmi2Status fmi2Terminate(fmi2Component component)
{
    return status(core_change_mode(component, INITIALIZED, TERMINATED, "termination"));
}

fmi2Status fmi2Reset(fmi2Component component)
{
    return status(core_reset(component));
}

/* Variables */

fmi2Status fmi2GetReal(fmi2Component component, const fmi2ValueReference references[], size_t n,
                       fmi2Real values[])
{
    return status(core_get(component, references, n, values, n));
}

fmi2Status fmi2SetReal(fmi2Component component, const fmi2ValueReference references[], size_t n,
                       const fmi2Real values[])
{
    return status(core_set(component, references, n, values, n));
}

#define NO_VARIABLES_OF(type)                                                                      \
    fmi2Status fmi2Get##type(fmi2Component component, const fmi2ValueReference references[],       \
                             size_t n, fmi2##type values[])                                        \
    {                                                                                              \
        (void)references, (void)n, (void)values;                                                   \
        return unsupported(component, "variables of type " #type);                                 \
    }                                                                                              \
    fmi2Status fmi2Set##type(fmi2Component component, const fmi2ValueReference references[],       \
                             size_t n, const fmi2##type values[])                                  \
    {                                                                                              \
        (void)references, (void)n, (void)values;                                                   \
        return unsupported(component, "variables of type " #type);                                 \
    }

NO_VARIABLES_OF(Integer)
NO_VARIABLES_OF(Boolean)
NO_VARIABLES_OF(String)

/* State */

fmi2Status fmi2GetFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    return status(core_get_state(component, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component component, fmi2FMUstate state)
{
    return status(core_set_state(component, state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component component, fmi2FMUstate *state)
{
    (void)component;
    return status(core_free_state(state));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component component, fmi2FMUstate state, size_t *size)
{
    (void)state;
    *size = sizeof(State);
    return status(core_expect(component, ANY_MODE, "asking for the size of a state"));
}

fmi2Status fmi2SerializeFMUstate(fmi2Component component, fmi2FMUstate state, fmi2Byte bytes[],
                                 size_t size)
{
    return status(core_serialize(component, state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component component, const fmi2Byte bytes[], size_t size,
                                   fmi2FMUstate *state)
{
    return status(core_deserialize(component, bytes, size, state));
}

/* Model exchange */

fmi2Status fmi2NewDiscreteStates(fmi2Component component, fmi2EventInfo *info)
{
    *info = (fmi2EventInfo){.newDiscreteStatesNeeded = fmi2False};
    return status(core_expect(component, EVENT, "updating discrete states"));
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component component, fmi2Boolean no_set_prior,
                                       fmi2Boolean *enter_event_mode, fmi2Boolean *terminate)
{
    (void)no_set_prior;
    *enter_event_mode = *terminate = fmi2False;
    return status(core_expect(component, CONTINUOUS_TIME, "completing an integrator step"));
}

fmi2Status fmi2SetTime(fmi2Component component, fmi2Real time)
{
    return status(core_set_time(component, time));
}

fmi2Status fmi2SetContinuousStates(fmi2Component component, const fmi2Real x[], size_t n)
{
    return status(core_set_states(component, x, n));
}

fmi2Status fmi2GetContinuousStates(fmi2Component component, fmi2Real x[], size_t n)
{
    return status(core_get_states(component, x, n));
}

fmi2Status fmi2GetDerivatives(fmi2Component component, fmi2Real dx[], size_t n)
{
    return status(core_get_derivatives(component, dx, n));
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component component, fmi2Real nominals[],
                                             size_t n)
{
    return status(core_get_nominals(component, nominals, n));
}

fmi2Status fmi2GetEventIndicators(fmi2Component component, fmi2Real indicators[], size_t n)
{
    (void)indicators;
    return n == 0 ? fmi2OK : unsupported(component, "event indicators");
}

/* Co-simulation */

fmi2Status fmi2DoStep(fmi2Component component, fmi2Real time, fmi2Real step,
                      fmi2Boolean no_set_prior)
{
    (void)no_set_prior;
    return status(core_step(component, time, step));
}

fmi2Status fmi2CancelStep(fmi2Component component)
{
    return unsupported(component, "asynchronous steps");
}

fmi2Status fmi2GetStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind, (void)value;
    return unsupported(component, "asynchronous steps");
}

fmi2Status fmi2GetRealStatus(fmi2Component component, const fmi2StatusKind kind, fmi2Real *value)
{
    if (kind != fmi2LastSuccessfulTime)
        return unsupported(component, "such status of type Real");
    if (!core_expect(component, STEP, "asking for the last successful time"))
        return fmi2Error;
    *value = ((Instance *)component)->state.values.time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Integer *value)
{
    (void)kind, (void)value;
    return unsupported(component, "status of type Integer");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component component, const fmi2StatusKind kind,
                                fmi2Boolean *value)
{
    if (kind != fmi2Terminated)
        return unsupported(component, "such status of type Boolean");
    *value = fmi2False;
    return status(core_expect(component, ANY_MODE, "asking for termination"));
}

fmi2Status fmi2GetStringStatus(fmi2Component component, const fmi2StatusKind kind,
                               fmi2String *value)
{
    (void)kind, (void)value;
    return unsupported(component, "status of type String");
}

/* What these FMUs do not have */

fmi2Status fmi2SetRealInputDerivatives(fmi2Component component,
                                       const fmi2ValueReference references[], size_t n,
                                       const fmi2Integer orders[], const fmi2Real values[])
{
    (void)references, (void)n, (void)orders, (void)values;
    return unsupported(component, "input derivatives");
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component component,
                                        const fmi2ValueReference references[], size_t n,
                                        const fmi2Integer orders[], fmi2Real values[])
{
    (void)references, (void)n, (void)orders, (void)values;
    return unsupported(component, "output derivatives");
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component component,
                                        const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns,
                                        const fmi2Real seed[], fmi2Real sensitivity[])
{
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)sensitivity;
    return unsupported(component, "directional derivatives");
}
