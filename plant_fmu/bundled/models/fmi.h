/* What FMI 2.0 and 3.0 spell alike, in terms of the core.
 *
 * FMI(name) is the version's own name of a type or a function; an instance is a pointer to a struct
 * that begins with an Instance. A call that the importer may make is one line: its name, what it
 * takes, and what the core does for it, or what these FMUs have not. */

#include <stdio.h>
#include <stdlib.h>

#include "core.h"

/* A call has the parameters of its standard, whether or not there is a use for them here. */
#pragma GCC diagnostic ignored "-Wunused-parameter"

static FMI(Status) status(bool done)
{
    return done ? FMI(OK) : FMI(Error);
}

static FMI(Status) unsupported(void *self, const char *what)
{
    return status(self && core_refuse(self, "this FMU has no %s", what));
}

#define CALL(name, parameters, done)                                                               \
    FMI(Status) FMI(name) parameters                                                               \
    {                                                                                              \
        return status(done);                                                                       \
    }
#define MODE(name, from, to, what)                                                                 \
    CALL(name, (void *self), core_change_mode(self, from, to, what))
#define NO(what, name, parameters)                                                                 \
    FMI(Status) FMI(name) parameters                                                               \
    {                                                                                              \
        return unsupported(self, what);                                                            \
    }

typedef const unsigned *References; /* value references */

const char *FMI(GetVersion)(void)
{
    return FMI(Version);
}

/* Only errors are logged, and always. */
CALL(SetDebugLogging, (void *self, FMI(Boolean) on, size_t n, const FMI(String) categories[]),
     core_expect(self, ANY_MODE, "setting the logging"))

/* Life */

void FMI(FreeInstance)(void *self)
{
    free(self);
}

CALL(ExitInitializationMode, (void *self), core_exit_initialization(self))
CALL(Reset, (void *self), core_reset(self))
MODE(EnterContinuousTimeMode, EVENT, CONTINUOUS_TIME, "entering continuous-time mode")
MODE(Terminate, INITIALIZED, TERMINATED, "termination")

/* Model exchange */

CALL(SetTime, (void *self, double time), core_set_time(self, time))
CALL(SetContinuousStates, (void *self, const double x[], size_t n), core_set_states(self, x, n))
CALL(GetContinuousStates, (void *self, double x[], size_t n), core_get_states(self, x, n))
CALL(GetNominalsOfContinuousStates, (void *self, double nominals[], size_t n),
     core_get_nominals(self, nominals, n))

FMI(Status) FMI(CompletedIntegratorStep)(void *self, FMI(Boolean) no_set_prior,
                                         FMI(Boolean) *enter_event_mode, FMI(Boolean) *terminate)
{
    if (!core_given(self, enter_event_mode, 1) || !core_given(self, terminate, 1))
        return FMI(Error);
    *enter_event_mode = *terminate = false;
    return status(core_accept_time(self, CONTINUOUS_TIME, "completing an integrator step"));
}

FMI(Status) FMI(GetEventIndicators)(void *self, double indicators[], size_t n)
{
    return n == 0 ? FMI(OK) : unsupported(self, "event indicators");
}

/* State */

static bool size_of_state(void *self, size_t *size)
{
    if (!core_expect(self, ANY_MODE, "asking for the size of a state") ||
        !core_given(self, size, 1))
        return false;
    *size = sizeof(State);
    return true;
}
