/* Random sequences of FMI calls, allowed and forbidden, on a bundled model that is linked in.
 *
 * What each call must answer is checked against FMI's own tables of where it is allowed (2.0.4,
 * sections 3.2.3 and 4.2.4; 3.0.2, section 2.3): where it is not, an error. An error is logged, and
 * leaves all bytes of the instance as they were, but for a step and what a get has calculated.
 * Sanitizers watch the rest. With a third argument a fault is committed that they must find.
 *
 *   call_fuzzing SEED SEQUENCES [leak | overflow | undefined] */

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core.h"

#if FMI_VERSION == 2
#include "fmi2Functions.h"
#define F(name) fmi2##name
#define STATE(verb) fmi2##verb##FMUstate
#define DESERIALIZE fmi2DeSerializeFMUstate
typedef char Byte;
#define SIZE_OF_STATE fmi2SerializedFMUstateSize
#define RATES fmi2GetDerivatives
#else
#include "fmi3Functions.h"
#define F(name) fmi3##name
#define STATE(verb) fmi3##verb##FMUState
#define DESERIALIZE fmi3DeserializeFMUState
typedef unsigned char Byte;
#define SIZE_OF_STATE fmi3SerializedFMUStateSize
#define RATES fmi3GetContinuousStateDerivatives
#endif

enum { CALLS = 40, MOST = 4 * VALUES };

static uint64_t drawn;
static unsigned long errors, calls;
static int messages;
static bool passed_null;

static unsigned draw(unsigned below)
{
    drawn = drawn * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)(drawn >> 33) % below;
}

/* Mostly a pointer; sometimes none, which must be an error. */
static void *maybe(const void *pointer)
{
    const bool none = draw(60) == 0;
    passed_null |= none;
    return none ? NULL : (void *)pointer;
}

static double number(void)
{
    /* Of few sizes, for those of many make equations stiff, and steps long. */
    static const double some[] = {-0.0, 1.0, 0.5, 2.0, 5.0, -1.0, 1.5, 1.0};
    static const double bad[] = {NAN, INFINITY, 0.0, 30.0};
    return draw(60) ? some[draw(sizeof some / sizeof *some)] : bad[draw(4)];
}

static void fail(const char *what, const char *call)
{
    fprintf(stderr, "%s: %s\n", call, what);
    abort();
}

#if FMI_VERSION == 2
static void hear(void *environment, fmi2String name, fmi2Status status, fmi2String category,
                 fmi2String message, ...)
{
    (void)environment, (void)name, (void)status, (void)category;
#else
static void hear(void *environment, fmi3Status status, fmi3String category, fmi3String message)
{
    (void)environment, (void)status, (void)category;
#endif
    if (!*message)
        fail("an empty message", "log");
    ++messages;
}

static void *new_instance(bool steps)
{
    const char *token = draw(50) ? INSTANTIATION_TOKEN : "another";
#if FMI_VERSION == 2
    static const fmi2CallbackFunctions callbacks = {.logger = hear};
    void *made = fmi2Instantiate("fuzz", steps ? fmi2CoSimulation : fmi2ModelExchange, token, "",
                                 &callbacks, false, false);
#else
    void *made = steps ? fmi3InstantiateCoSimulation("fuzz", token, "", false, false, draw(50) == 0,
                                                     false, NULL, 0, NULL, hear, NULL)
                       : fmi3InstantiateModelExchange("fuzz", token, "", false, false, NULL, hear);
#endif
    return made;
}

typedef struct {
    void *self, *kept; /* an instance, and a state of one of its kind */
    State before;
} Fuzz;

enum { KEEPS = 1, CHANGES = 2 };

/* Makes a call; `modes` are those in which FMI allows it, `effect` whether an error may change. */
#define CALL(fuzz, modes, effect, name, ...)                                                       \
    do {                                                                                           \
        const State *now = &((Instance *)(fuzz)->self)->state;                                     \
        memcpy(&(fuzz)->before, now, sizeof *now);                                                 \
        passed_null = false;                                                                       \
        const int heard = messages;                                                                \
        const int status = (int)name(__VA_ARGS__);                                                 \
        ++calls;                                                                                   \
        if (status != 0 && status != 3)                                                            \
            fail("neither OK nor an error", #name);                                                \
        if (status == 3) {                                                                         \
            ++errors;                                                                              \
            if (messages == heard)                                                                 \
                fail("an error without a message", #name);                                         \
            if ((effect) == KEEPS && memcmp(&(fuzz)->before, now, sizeof *now))                    \
                fail("an error has left a trace", #name);                                          \
        } else if (!((int)(fuzz)->before.mode & (modes)))                                          \
            fail("allowed where FMI forbids it", #name);                                           \
        else if (passed_null)                                                                      \
            fail("went on without a pointer", #name);                                              \
    } while (0)

static const int SET_IN = BEFORE_START | INITIALIZED;

static size_t some_variables(unsigned references[MOST], size_t *n_values)
{
    const size_t n = 1 + draw(3);
    *n_values = 0;
    for (size_t i = 0; i < n; ++i) {
        references[i] = draw(VALUES + 1);
        while (references[i] < VALUES && variables[references[i]].rows.most == 0 && draw(9))
            --references[i]; /* to where an array begins */
        const Length none = {0, 0};
        const Length rows = references[i] < VALUES ? variables[references[i]].rows : none;
        const Length columns = references[i] < VALUES ? variables[references[i]].columns : none;
        *n_values += rows.by ? 3 * (columns.by ? 3 : columns.most) : rows.most * columns.most;
    }
    if (FMI_VERSION == 2)
        *n_values = n;
    else if (draw(10) == 0)
        *n_values += draw(3) - 1;
    if (*n_values > MOST)
        *n_values = MOST;
    return n;
}

static void tamper(Byte *bytes, size_t size)
{
    static const double edges[] = {NAN, INFINITY, -1.0, -0.5, 0.0, 17.0, 0.5, 3.0};
    const size_t at = draw((unsigned)(size / sizeof(double))) * sizeof(double);
    switch (draw(4)) {
    case 0: break;
    case 1: bytes[draw((unsigned)size)] ^= (Byte)(1 << draw(8)); break;
    case 2: memcpy(bytes + at, &edges[draw(8)], sizeof(double)); break;
    case 3: memset(bytes + sizeof INSTANTIATION_TOKEN, (int)draw(256), 16 + draw(8)); break;
    }
}

static void fuzz_states(Fuzz *f)
{
    static Byte bytes[sizeof(State)];
    size_t size = 0;
    switch (draw(4)) {
    case 0: CALL(f, ANY_MODE, KEEPS, STATE(Get), f->self, maybe(&f->kept)); break;
    case 1: CALL(f, ANY_MODE, KEEPS, STATE(Set), f->self, f->kept); break;
    case 2: CALL(f, ANY_MODE, KEEPS, STATE(Free), f->self, maybe(&f->kept)); break;
    case 3:
        CALL(f, ANY_MODE, KEEPS, SIZE_OF_STATE, f->self, f->kept, maybe(&size));
        CALL(f, ANY_MODE, KEEPS, STATE(Serialize), f->self, f->kept, maybe(bytes), sizeof bytes);
        tamper(bytes, sizeof bytes);
        CALL(f, ANY_MODE, KEEPS, DESERIALIZE, f->self, maybe(bytes),
             draw(20) ? sizeof bytes : sizeof bytes - 1, maybe(&f->kept));
        CALL(f, ANY_MODE, KEEPS, STATE(Set), f->self, f->kept);
        break;
    }
}

static void fuzz_variables(Fuzz *f)
{
    static double values[MOST];
    unsigned references[MOST];
    size_t n_values;
    const size_t n = some_variables(references, &n_values);
    for (size_t i = 0; i < n_values; ++i)
        values[i] = number();
#if FMI_VERSION == 2
    if (draw(2))
        CALL(f, ANY_MODE, CHANGES, fmi2GetReal, f->self, maybe(references), n, maybe(values));
    else
        CALL(f, SET_IN, KEEPS, fmi2SetReal, f->self, maybe(references), n, maybe(values));
#else
    uint64_t count = draw(8) ? 1 + draw(5) : draw(30);
    switch (draw(5)) {
    case 0:
    case 1:
        CALL(f, ANY_MODE, CHANGES, fmi3GetFloat64, f->self, maybe(references), n, maybe(values),
             n_values);
        break;
    case 2:
    case 3:
        CALL(f, SET_IN, KEEPS, fmi3SetFloat64, f->self, maybe(references), n, maybe(values),
             n_values);
        break;
    case 4:
        *references = draw(3) ? 1 : *references;
        CALL(f, CONFIGURATION, KEEPS, fmi3SetUInt64, f->self, maybe(references), 1, maybe(&count), 1);
        break;
    }
#endif
}

static void fuzz_exchange(Fuzz *f)
{
    F(Boolean) event, end;
    const State *state = &((Instance *)f->self)->state;
    const size_t n = (size_t)states_in(&state->values) - (draw(20) == 0);
    double *x = malloc(n * sizeof *x); /* of no more room, so that what goes beyond is seen */
    for (size_t i = 0; i < n; ++i)
        x[i] = number();
    const int solved = INITIALIZATION | EVENT | CONTINUOUS_TIME | STEP | TERMINATED | BEFORE_START |
                       CONFIGURATION; /* reading is let be wherever there are numbers */
    switch (draw(6)) {
    case 0:
        CALL(f, EVENT | CONTINUOUS_TIME, KEEPS, F(SetTime), f->self,
             draw(9) ? state->values.time + 0.1 : number());
        break;
    case 1: CALL(f, CONTINUOUS_TIME, KEEPS, F(SetContinuousStates), f->self, maybe(x), n); break;
    case 2: CALL(f, solved, CHANGES, F(GetContinuousStates), f->self, maybe(x), n); break;
    case 3: CALL(f, solved, CHANGES, RATES, f->self, maybe(x), n); break;
    case 4: CALL(f, solved, KEEPS, F(GetNominalsOfContinuousStates), f->self, maybe(x), n); break;
    case 5:
        CALL(f, CONTINUOUS_TIME, KEEPS, F(CompletedIntegratorStep), f->self, true, maybe(&event),
             maybe(&end));
        break;
    }
    free(x);
}

static void fuzz_steps(Fuzz *f)
{
    static const double steps[] = {0.001, 0.01, 0.002, 0.05, 0.0, -0.1, NAN, 1e-18};
    const double time = draw(12) ? ((Instance *)f->self)->state.values.time : number();
    const double step = steps[draw(draw(4) ? 4 : 8)];
#if FMI_VERSION == 2
    CALL(f, STEP, CHANGES, fmi2DoStep, f->self, time, step, true);
#else
    bool event, end, early;
    double reached;
    CALL(f, STEP, CHANGES, fmi3DoStep, f->self, time, step, true, maybe(&event), maybe(&end),
         maybe(&early), maybe(&reached));
#endif
}

static void enter_initialization(Fuzz *f)
{
    const double start = draw(5) ? 0.0 : number(), stop = draw(5) ? 1.0 : number();
    const bool with_stop = draw(2), with_tolerance = draw(4) == 0;
    const double tolerance = draw(2) ? 1e-6 : number();
#if FMI_VERSION == 2
    if (draw(9))
        CALL(f, INSTANTIATED, KEEPS, fmi2SetupExperiment, f->self, with_tolerance, tolerance, start,
             with_stop, stop);
    CALL(f, INSTANTIATED, KEEPS, fmi2EnterInitializationMode, f->self);
#else
    CALL(f, INSTANTIATED, KEEPS, fmi3EnterInitializationMode, f->self, with_tolerance, tolerance,
         start, with_stop, stop);
#endif
}

static void update(Fuzz *f)
{
#if FMI_VERSION == 2
    fmi2EventInfo info;
    CALL(f, EVENT, KEEPS, fmi2NewDiscreteStates, f->self, maybe(&info));
#else
    bool needs[5];
    double next;
    CALL(f, EVENT, KEEPS, fmi3UpdateDiscreteStates, f->self, maybe(needs), maybe(needs + 1),
         maybe(needs + 2), maybe(needs + 3), maybe(needs + 4), maybe(&next));
#endif
}

/* How many there are, and how the last step went. */
static void ask(Fuzz *f)
{
#if FMI_VERSION == 2
    fmi2Real time;
    fmi2Boolean end;
    CALL(f, STEP, KEEPS, fmi2GetRealStatus, f->self, fmi2LastSuccessfulTime, maybe(&time));
    CALL(f, ANY_MODE, KEEPS, fmi2GetBooleanStatus, f->self, fmi2Terminated, maybe(&end));
#else
    uint64_t count;
    size_t n;
    const unsigned first = 1;
    CALL(f, ANY_MODE, KEEPS, fmi3GetUInt64, f->self, maybe(&first), 1, maybe(&count), 1);
    CALL(f, ANY_MODE, KEEPS, fmi3GetNumberOfContinuousStates, f->self, maybe(&n));
    CALL(f, ANY_MODE, KEEPS, fmi3GetNumberOfEventIndicators, f->self, maybe(&n));
#endif
}

/* What comes next in a simulation. */
static void go_on(Fuzz *f)
{
    switch (((Instance *)f->self)->state.mode) {
    case INSTANTIATED: enter_initialization(f); break;
    case INITIALIZATION:
        CALL(f, INITIALIZATION, KEEPS, F(ExitInitializationMode), f->self);
        break;
    case EVENT:
        update(f);
        CALL(f, EVENT, KEEPS, F(EnterContinuousTimeMode), f->self);
        break;
    case TERMINATED: CALL(f, ANY_MODE, KEEPS, F(Reset), f->self); break;
#if FMI_VERSION == 3
    case CONFIGURATION: CALL(f, CONFIGURATION, KEEPS, fmi3ExitConfigurationMode, f->self); break;
#endif
    default: ask(f); break;
    }
}

static void fuzz_life(Fuzz *f)
{
    if (draw(4)) {
        go_on(f);
        return;
    }
    switch (draw(draw(20) ? 8 : 10)) {
    case 0:
    case 1: enter_initialization(f); break;
    case 2:
    case 3: CALL(f, INITIALIZATION, KEEPS, F(ExitInitializationMode), f->self); break;
    case 4: CALL(f, EVENT, KEEPS, F(EnterContinuousTimeMode), f->self); break;
    case 5: /* FMI 2 lets nothing be done by it in event mode, and nothing is */
        CALL(f, CONTINUOUS_TIME | (FMI_VERSION == 2 ? EVENT : 0), KEEPS, F(EnterEventMode), f->self);
        break;
#if FMI_VERSION == 3
    case 6: CALL(f, INSTANTIATED, KEEPS, fmi3EnterConfigurationMode, f->self); break;
    case 7: CALL(f, CONFIGURATION, KEEPS, fmi3ExitConfigurationMode, f->self); break;
#endif
    case 8: CALL(f, INITIALIZED, KEEPS, F(Terminate), f->self); break;
    case 9: CALL(f, ANY_MODE, KEEPS, F(Reset), f->self); break;
    }
}

static void sequence(void)
{
    Fuzz f = {.self = new_instance(draw(2))};
    if (!f.self)
        return;
    for (int i = 0; i < CALLS; ++i)
        switch (draw(8)) {
        case 0:
        case 1: fuzz_life(&f); break;
        case 2:
        case 3: fuzz_variables(&f); break;
        case 4: fuzz_exchange(&f); break;
        case 5:
        case 6: fuzz_steps(&f); break;
        case 7: fuzz_states(&f); break;
        }
    if (f.kept)
        STATE(Free)(f.self, &f.kept);
    F(FreeInstance)(f.self);
}

static void commit(const char *fault)
{
    volatile int zero = 0, most = 2147483647;
    char *volatile lost = malloc(8);
    if (!strcmp(fault, "overflow"))
        lost[8 + zero] = 1;
    if (!strcmp(fault, "undefined"))
        most = most + 1 + zero;
    if (strcmp(fault, "leak"))
        free(lost);
    lost = NULL;
}

int main(int n, char *arguments[])
{
    if (n > 3)
        commit(arguments[3]);
    const unsigned long first = strtoul(arguments[1], NULL, 10);
    const unsigned long many = strtoul(arguments[2], NULL, 10);
    for (unsigned long i = 0; i < many; ++i) {
        drawn = (first + i) * 0x9E3779B97F4A7C15u;
        sequence();
    }
    printf("%lu %lu %lu\n", many, calls, errors);
    return 0;
}
