/* One joint on which only its torque acts, J q'' = tau, and one of four things happens to it:
 *
 *   wall   a state event: where q falls through 0 it bounces, q' becomes -e q'
 *   load   a time event: at t_load the inertia doubles
 *   turn   a step event: after a step with q > pi the FMU asks for one, and takes 2 pi off q
 *   end    the simulation is ended by the FMU after t_load
 *
 * FMI 2.0 or 3.0 for Model Exchange by -DFMI, the states' nominal value by -DNOMINAL. With
 * -DSTART it starts there, whatever q is set to before. No header is needed: the calls are plain C. */

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

enum { TIME, TAU, Q, QD, RATE, ACCELERATION, INDICATOR, INERTIA, E, T_LOAD, WALL, LOAD, TURN, END, N };

typedef struct {
    double v[N];
    bool loaded;
} Hinge;

static Hinge *new_hinge(void)
{
    Hinge *h = calloc(1, sizeof *h);
    h->v[INERTIA] = 1.0;
    h->v[E] = 0.5;
    return h;
}

static void update(Hinge *h)
{
    h->v[RATE] = h->v[QD];
    h->v[ACCELERATION] = h->v[TAU] / (h->v[INERTIA] * (h->loaded ? 2.0 : 1.0));
    h->v[INDICATOR] = h->v[WALL] != 0.0 ? h->v[Q] : 1.0;
}

static bool pending(const Hinge *h)
{
    return h->v[LOAD] != 0.0 && !h->loaded;
}

/* An event; returns whether the states changed. */
static bool event(Hinge *h)
{
    bool changed = false;
    if (h->v[WALL] != 0.0 && h->v[Q] <= 0.0 && h->v[QD] < 0.0) {
        h->v[Q] = 1e-300;
        h->v[QD] *= -h->v[E];
        changed = true;
    }
    if (pending(h) && h->v[TIME] >= h->v[T_LOAD])
        h->loaded = true;
    if (h->v[TURN] != 0.0 && h->v[Q] > 3.141592653589793) {
        h->v[Q] -= 2.0 * 3.141592653589793;
        changed = true;
    }
    return changed;
}

static bool wants_event(const Hinge *h)
{
    return h->v[TURN] != 0.0 && h->v[Q] > 3.141592653589793;
}

static bool ended(const Hinge *h)
{
    return h->v[END] != 0.0 && h->v[TIME] > h->v[T_LOAD];
}

static int get(Hinge *h, const unsigned r[], size_t n, double values[])
{
    update(h);
    for (size_t i = 0; i < n; ++i)
        values[i] = h->v[r[i]];
    return 0;
}

static int set(Hinge *h, const unsigned r[], size_t n, const double values[])
{
    for (size_t i = 0; i < n; ++i)
        h->v[r[i]] = values[i];
    return 0;
}

static int initialised(Hinge *h)
{
#ifdef START
    h->v[Q] = START;
#endif
    (void)h;
    return 0;
}

static int set_time(Hinge *h, double t) { return h->v[TIME] = t, 0; }
static int set_states(Hinge *h, const double x[], size_t n) { return memcpy(h->v + Q, x, n * sizeof *x), 0; }
static int get_states(Hinge *h, double x[], size_t n) { return memcpy(x, h->v + Q, n * sizeof *x), 0; }
static int get_rates(Hinge *h, double dx[], size_t n) { return update(h), memcpy(dx, h->v + RATE, n * sizeof *dx), 0; }
static int get_indicators(Hinge *h, double z[], size_t n) { return update(h), memcpy(z, h->v + INDICATOR, n * sizeof *z), 0; }
static int get_nominals(Hinge *h, double x[], size_t n) { (void)h; for (size_t i = 0; i < n; ++i) x[i] = NOMINAL; return 0; }
static int copy(const void *h, Hinge **s)
{
    if (!*s)
        *s = malloc(sizeof **s);
    memcpy(*s, h, sizeof **s);
    return 0;
}
static int reset(Hinge *h) { Hinge *n = new_hinge(); *h = *n; free(n); return 0; }

#if FMI == 2

typedef struct { int again, terminate, nominals, states, planned; double next; } Info;

Hinge *fmi2Instantiate(void) { return new_hinge(); }
int fmi2SetupExperiment(Hinge *h, int a, double b, double start, int c, double d) { (void)a, (void)b, (void)c, (void)d; return set_time(h, start); }
int fmi2EnterInitializationMode(Hinge *h) { (void)h; return 0; }
int fmi2ExitInitializationMode(Hinge *h) { return initialised(h); }
int fmi2Reset(Hinge *h) { return reset(h); }
void fmi2FreeInstance(Hinge *h) { free(h); }
int fmi2GetFMUstate(Hinge *h, Hinge **s) { return copy(h, s); }
int fmi2SetFMUstate(Hinge *h, const Hinge *s) { return *h = *s, 0; }
int fmi2FreeFMUstate(Hinge *h, Hinge **s) { (void)h, free(*s); return *s = NULL, 0; }
int fmi2SerializedFMUstateSize(Hinge *h, Hinge *s, size_t *n) { (void)h, (void)s; return *n = sizeof *s, 0; }
int fmi2SerializeFMUstate(Hinge *h, const Hinge *s, void *bytes, size_t n) { (void)h; return memcpy(bytes, s, n), 0; }
int fmi2DeSerializeFMUstate(Hinge *h, const void *bytes, size_t n, Hinge **s) { (void)h, (void)n; return copy(bytes, s); }
int fmi2SetReal(Hinge *h, const unsigned r[], size_t n, const double v[]) { return set(h, r, n, v); }
int fmi2GetReal(Hinge *h, const unsigned r[], size_t n, double v[]) { return get(h, r, n, v); }
int fmi2SetTime(Hinge *h, double t) { return set_time(h, t); }
int fmi2SetContinuousStates(Hinge *h, const double x[], size_t n) { return set_states(h, x, n); }
int fmi2GetContinuousStates(Hinge *h, double x[], size_t n) { return get_states(h, x, n); }
int fmi2GetDerivatives(Hinge *h, double x[], size_t n) { return get_rates(h, x, n); }
int fmi2GetEventIndicators(Hinge *h, double z[], size_t n) { return get_indicators(h, z, n); }
int fmi2GetNominalsOfContinuousStates(Hinge *h, double x[], size_t n) { return get_nominals(h, x, n); }
int fmi2EnterEventMode(Hinge *h) { (void)h; return 0; }
int fmi2EnterContinuousTimeMode(Hinge *h) { (void)h; return 0; }
int fmi2CompletedIntegratorStep(Hinge *h, int n, int *enter, int *end) { (void)n; *enter = wants_event(h); *end = ended(h); return 0; }
int fmi2NewDiscreteStates(Hinge *h, Info *info)
{
    const bool changed = event(h);
    *info = (Info){changed, ended(h), 0, changed, pending(h), h->v[T_LOAD]};
    return 0;
}

#else

Hinge *fmi3InstantiateModelExchange(void) { return new_hinge(); }
int fmi3EnterInitializationMode(Hinge *h, bool a, double b, double start, bool c, double d) { (void)a, (void)b, (void)c, (void)d; return set_time(h, start); }
int fmi3ExitInitializationMode(Hinge *h) { return initialised(h); }
int fmi3Reset(Hinge *h) { return reset(h); }
void fmi3FreeInstance(Hinge *h) { free(h); }
int fmi3GetFMUState(Hinge *h, Hinge **s) { return copy(h, s); }
int fmi3SetFMUState(Hinge *h, const Hinge *s) { return *h = *s, 0; }
int fmi3FreeFMUState(Hinge *h, Hinge **s) { (void)h, free(*s); return *s = NULL, 0; }
int fmi3SerializedFMUStateSize(Hinge *h, Hinge *s, size_t *n) { (void)h, (void)s; return *n = sizeof *s, 0; }
int fmi3SerializeFMUState(Hinge *h, const Hinge *s, void *bytes, size_t n) { (void)h; return memcpy(bytes, s, n), 0; }
int fmi3DeserializeFMUState(Hinge *h, const void *bytes, size_t n, Hinge **s) { (void)h, (void)n; return copy(bytes, s); }
int fmi3SetFloat64(Hinge *h, const unsigned r[], size_t n, const double v[], size_t m) { (void)m; return set(h, r, n, v); }
int fmi3GetFloat64(Hinge *h, const unsigned r[], size_t n, double v[], size_t m) { (void)m; return get(h, r, n, v); }
int fmi3SetTime(Hinge *h, double t) { return set_time(h, t); }
int fmi3SetContinuousStates(Hinge *h, const double x[], size_t n) { return set_states(h, x, n); }
int fmi3GetContinuousStates(Hinge *h, double x[], size_t n) { return get_states(h, x, n); }
int fmi3GetContinuousStateDerivatives(Hinge *h, double x[], size_t n) { return get_rates(h, x, n); }
int fmi3GetEventIndicators(Hinge *h, double z[], size_t n) { return get_indicators(h, z, n); }
int fmi3GetNominalsOfContinuousStates(Hinge *h, double x[], size_t n) { return get_nominals(h, x, n); }
int fmi3EnterEventMode(Hinge *h) { (void)h; return 0; }
int fmi3EnterContinuousTimeMode(Hinge *h) { (void)h; return 0; }
int fmi3CompletedIntegratorStep(Hinge *h, bool n, bool *enter, bool *end) { (void)n; *enter = wants_event(h); *end = ended(h); return 0; }
int fmi3UpdateDiscreteStates(Hinge *h, bool *again, bool *end, bool *nominals, bool *states, bool *planned, double *next)
{
    *again = *states = event(h);
    *end = ended(h);
    *nominals = false;
    *planned = pending(h);
    *next = h->v[T_LOAD];
    return 0;
}

#endif
