/* Two joints on springs that move by steps of their own: M q" = tau - 4 q - D q', with a torque that
 * is taken over at each step of -DSTEP s, by Euler's semi-implicit method. The energy of that is
 * kept, but for the damping -DDAMPING. The inverse of M is -DMOBILITY. q is told in units of 1/-DRATE.
 *
 * Where -DSTRICT, a step of the importer must be a whole number of its own. Where -DLASTING, a reset
 * after 0.5 s forgets to set its clock back, and it stands still until then. FMI 2.0 or 3.0 for
 * Co-Simulation by -DFMI. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#if FMI == 2
#include "fmi2FunctionTypes.h"
#else
#include "fmi3FunctionTypes.h"
#endif

enum { Q, QD = 2, TAU = 4, N = 6 };

typedef struct {
    double v[N], time;
    long steps;
} Joints;

static const double mobility[2][2] = MOBILITY;

static int reset(Joints *joints)
{
    const long steps = LASTING && joints->steps * (STEP) > 0.5 ? joints->steps : 0;
    memset(joints, 0, sizeof *joints);
    joints->steps = steps;
    return 0;
}

static int get(const Joints *joints, const unsigned r[], size_t n, double values[])
{
    for (size_t i = 0; i < n; ++i)
        values[i] = joints->v[r[i]];
    return 0;
}

static int set(Joints *joints, const unsigned r[], size_t n, const double values[])
{
    for (size_t i = 0; i < n; ++i)
        joints->v[r[i]] = values[i];
    return 0;
}

static int step(Joints *joints, double t, double h)
{
    double *v = joints->v;
    if (STRICT && fabs(h / (STEP) - round(h / (STEP))) > 1e-6)
        return 3;
    for (; (double)(joints->steps + 1) * (STEP) <= t + h + 1e-9 * (STEP); ++joints->steps) {
        double force[2];
        for (int i = 0; i < 2; ++i)
            force[i] = v[TAU + i] - 4.0 * v[Q + i] / (RATE) - (DAMPING) * v[QD + i];
        for (int i = 0; i < 2; ++i)
            v[QD + i] += (STEP) * (mobility[i][0] * force[0] + mobility[i][1] * force[1]);
        for (int i = 0; i < 2; ++i)
            v[Q + i] += (STEP) * (RATE) * v[QD + i];
    }
    return 0;
}

#if FMI == 2

void *fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                      const fmi2CallbackFunctions *given, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)name, (void)type, (void)guid, (void)resources, (void)given, (void)visible, (void)logging;
    return calloc(1, sizeof(Joints));
}
void fmi2FreeInstance(void *joints) { free(joints); }
int fmi2Reset(void *joints) { return reset(joints); }
int fmi2SetupExperiment(void) { return 0; }
int fmi2EnterInitializationMode(void) { return 0; }
int fmi2ExitInitializationMode(void) { return 0; }
int fmi2SetReal(void *j, const unsigned r[], size_t n, const double v[]) { return set(j, r, n, v); }
int fmi2GetReal(void *j, const unsigned r[], size_t n, double v[]) { return get(j, r, n, v); }
int fmi2DoStep(void *joints, double t, double h) { return step(joints, t, h); }

#else

void *fmi3InstantiateCoSimulation(void) { return calloc(1, sizeof(Joints)); }
void fmi3FreeInstance(void *joints) { free(joints); }
int fmi3Reset(void *joints) { return reset(joints); }
int fmi3EnterInitializationMode(void) { return 0; }
int fmi3ExitInitializationMode(void) { return 0; }
int fmi3SetFloat64(void *j, const unsigned r[], size_t n, const double v[], size_t m)
{
    return (void)m, set(j, r, n, v);
}
int fmi3GetFloat64(void *j, const unsigned r[], size_t n, double v[], size_t m)
{
    return (void)m, get(j, r, n, v);
}
int fmi3DoStep(void *joints, double t, double h, fmi3Boolean no_set_state, fmi3Boolean *event,
               fmi3Boolean *terminate, fmi3Boolean *early, double *last)
{
    (void)no_set_state;
    *event = *terminate = *early = 0;
    *last = t + h;
    return step(joints, t, h);
}

#endif
