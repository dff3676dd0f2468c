/* The FMI 3.0 shim of the bundled models, but for two calls in which a fault may happen.
 *
 * The first thing that a process does with it is to write its id into the FIFO named by
 * FAULTY_LIFE, which it keeps open: a reader finds the end when the last such process ended. */

#define _POSIX_C_SOURCE 200809L

#include "fmi3Functions.h"

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#undef fmi3DoStep
#undef fmi3ExitInitializationMode
#define fmi3DoStep healthy_step
#define fmi3ExitInitializationMode healthy_exit
#include "healthy.h"
#undef fmi3DoStep
#undef fmi3ExitInitializationMode

enum { NONE, SEGFAULT, ABORT, EXIT, HANG, DISCARD, ERROR, FATAL, NOT_A_NUMBER, ENDS, RETURNS_EARLY,
       NO_STATUS };

static int life = -1;

static void tell(const char *text)
{
    if (life >= 0 && write(life, text, strlen(text)) < 0)
        abort();
}

__attribute__((constructor)) static void begin(void)
{
    const char *path = getenv("FAULTY_LIFE"), *load = getenv("FAULTY_LOAD");
    char text[32];
    if (path)
        life = open(path, O_WRONLY);
    snprintf(text, sizeof text, "%ld\n", (long)getpid());
    tell(text);
    if (load)
        abort();
}

static fmi3Status fail(Component *component)
{
    Values *values = &component->core.state.values;
    printf("fault %d is due\n", (int)values->fault);
    switch ((int)values->fault) {
    case SEGFAULT:
        raise(SIGSEGV);
        break;
    case ABORT:
        abort();
    case EXIT:
        exit(7);
    case HANG:
        tell("hangs\n");
        for (;;)
            pause();
    case DISCARD:
        return fmi3Discard;
    case ERROR:
        return fmi3Error;
    case FATAL:
        return fmi3Fatal;
    case NOT_A_NUMBER:
        values->q[0] = NAN;
        break;
    case NO_STATUS:
        return (fmi3Status)-1;
    }
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    Component *component = instance;
    const Values *values = &component->core.state.values;
    if (values->fault != NONE && values->fault_time < 0.0)
        return fail(component);
    return healthy_exit(instance);
}

fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 time, fmi3Float64 step,
                      fmi3Boolean no_set_state, fmi3Boolean *event, fmi3Boolean *terminate,
                      fmi3Boolean *early, fmi3Float64 *last)
{
    Component *component = instance;
    const Values *values = &component->core.state.values;
    const fmi3Status done =
        healthy_step(instance, time, step, no_set_state, event, terminate, early, last);
    if (done == fmi3OK && values->fault != NONE && time + step > values->fault_time) {
        *terminate = values->fault == ENDS;
        *early = values->fault == RETURNS_EARLY;
        return fail(component);
    }
    return done;
}
