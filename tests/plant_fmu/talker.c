/* A joint of inertia 1 that keeps the pointer to what it may call, and calls it as long as it
 * lives: as it is born, with the step that it refuses, and in FreeInstance, where it is freed by it
 * as well. The step that it refuses is the first that ends after |refuses|: with Error, or with
 * Fatal where `refuses` is negative, and then it ends the process if it is freed.
 *
 * Where -DSTART is a number, `origin` has it at first, and q starts at `origin`, whatever it is set
 * to before. FMI 2.0 or 3.0 for Co-Simulation by -DFMI; its environment and its name as it tells
 * them by -DENVIRONMENT and -DNAME. Where -DPRINTS is 1 it prints a line as it is born. */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#if FMI == 2
#include "fmi2FunctionTypes.h"
typedef fmi2CallbackFunctions Callbacks;
#else
#include "fmi3FunctionTypes.h"
typedef struct {
    fmi3LogMessageCallback logger;
    void *componentEnvironment;
} Callbacks;
#endif

enum { Q, QD, TAU, REFUSES, ORIGIN, N };

typedef struct {
    const Callbacks *given;
    char name[64];
    int dead;
    double v[N];
} Joint;

static void say(Joint *joint, const char *what)
{
    const Callbacks *given = joint->given;
#if FMI == 2
    given->logger(ENVIRONMENT, NAME, fmi2OK, "life", "%s as no. %d, %.2f", what, 7, 0.25);
#else
    given->logger(ENVIRONMENT, fmi3OK, "life", what);
#endif
}

static Joint *born(void *memory, const Callbacks *given, const char *name)
{
    Joint *joint = memory;
    joint->given = given;
    joint->v[ORIGIN] = START;
    strncpy(joint->name, name, sizeof joint->name - 1);
    if (PRINTS)
        printf("printed by an FMU\n");
    say(joint, "born");
    return joint;
}

static void end(const Joint *joint)
{
    if (joint->dead)
        abort();
}

static int reset(Joint *joint)
{
    memset(joint->v, 0, sizeof joint->v);
    joint->v[ORIGIN] = START;
    return 0;
}

static int begin(Joint *joint)
{
    if (!isnan(joint->v[ORIGIN]))
        joint->v[Q] = joint->v[ORIGIN];
    return 0;
}

static int get(const Joint *joint, const unsigned r[], size_t n, double values[])
{
    for (size_t i = 0; i < n; ++i)
        values[i] = joint->v[r[i]];
    return 0;
}

static int set(Joint *joint, const unsigned r[], size_t n, const double values[])
{
    for (size_t i = 0; i < n; ++i)
        joint->v[r[i]] = values[i];
    return 0;
}

static int step(Joint *joint, double t, double h)
{
    double *v = joint->v;
    if (v[REFUSES] != 0.0 && t + h > fabs(v[REFUSES])) {
        say(joint, "refused");
        joint->dead = v[REFUSES] < 0.0;
        return joint->dead ? 4 : 3;
    }
    v[Q] += v[QD] * h + v[TAU] * h * h / 2.0;
    v[QD] += v[TAU] * h;
    return 0;
}

#if FMI == 2

void *fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                      const fmi2CallbackFunctions *given, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)type, (void)guid, (void)resources, (void)visible, (void)logging;
    return born(given->allocateMemory(1, sizeof(Joint)), given, name);
}

void fmi2FreeInstance(void *instance)
{
    Joint *joint = instance;
    const fmi2CallbackFunctions *given = joint->given;
    end(joint);
    char *memory = given->allocateMemory(16, 1);
    strcpy(memory, "freed");
    say(joint, memory);
    given->freeMemory(memory);
    given->freeMemory(joint);
}

int fmi2Reset(void *joint) { return reset(joint); }
int fmi2SetupExperiment(void) { return 0; }
int fmi2EnterInitializationMode(void) { return 0; }
int fmi2ExitInitializationMode(void *joint) { return begin(joint); }
int fmi2SetReal(void *j, const unsigned r[], size_t n, const double v[]) { return set(j, r, n, v); }
int fmi2GetReal(void *j, const unsigned r[], size_t n, double v[]) { return get(j, r, n, v); }
int fmi2SetBoolean(void) { return 0; }
int fmi2SetInteger(void) { return 0; }
int fmi2DoStep(void *joint, double t, double h) { return step(joint, t, h); }

#else

void *fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                  fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                  fmi3Boolean early, const fmi3ValueReference r[], size_t n,
                                  fmi3InstanceEnvironment environment,
                                  fmi3LogMessageCallback logger,
                                  fmi3IntermediateUpdateCallback update)
{
    (void)token, (void)resources, (void)visible, (void)logging, (void)events, (void)early;
    (void)r, (void)n, (void)update;
    Callbacks *given = calloc(1, sizeof *given);
    *given = (Callbacks){logger, environment};
    return born(calloc(1, sizeof(Joint)), given, name);
}

void fmi3FreeInstance(void *instance)
{
    Joint *joint = instance;
    end(joint);
    say(joint, "freed");
    free((void *)joint->given);
    free(joint);
}

int fmi3Reset(void *joint) { return reset(joint); }
int fmi3EnterInitializationMode(void) { return 0; }
int fmi3ExitInitializationMode(void *joint) { return begin(joint); }
int fmi3SetFloat64(void *j, const unsigned r[], size_t n, const double v[], size_t m)
{
    return (void)m, set(j, r, n, v);
}
int fmi3GetFloat64(void *j, const unsigned r[], size_t n, double v[], size_t m)
{
    return (void)m, get(j, r, n, v);
}
int fmi3DoStep(void *joint, double t, double h, fmi3Boolean no_set_state, fmi3Boolean *event,
               fmi3Boolean *terminate, fmi3Boolean *early, double *last)
{
    (void)no_set_state;
    *event = *terminate = *early = 0;
    *last = t + h;
    return step(joint, t, h);
}

#endif
