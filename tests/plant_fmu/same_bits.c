/* What a model and sin and cos come to, as bits: of an arm that follows jumping references over
 * 60 intervals, argv[1] its integrator, argv[2] its relative tolerance; with argv[3] it weighs
 * little, so that its gains make it stiff. The numbers whose sin and
 * cos are told are on standard input. Beside the bits, how often the right-hand side was asked. */

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define model_derivatives counted_derivatives
#include "robot.c"
#undef model_derivatives
#include "core.h"
#include "mathematics.h"

enum { INTERVALS = 60 };

static long evaluations;

void model_derivatives(const Values *values, double t, const double x[STATES], double dx[STATES])
{
    ++evaluations;
    counted_derivatives(values, t, x, dx);
}

static void tell(const Instance *self, const char *message)
{
    (void)self;
    fprintf(stderr, "%s\n", message);
    exit(1);
}

static void print(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    printf("%016" PRIx64 "\n", bits);
}

static void set(Instance *self, double *field, size_t count, const double numbers[])
{
    const unsigned reference = (unsigned)(field - (double *)&self->state.values);
    core_set(self, &reference, 1, numbers, count);
}

int main(int count, char **arguments)
{
    double x, s, c;
    while (scanf("%la", &x) == 1) {
        sine_and_cosine(x, &s, &c);
        print(s);
        print(c);
    }
    Instance arm;
    memset(&arm, 0, sizeof arm);
    arm.whole_variables = true;
    arm.log_error = tell;
    core_instantiate(&arm, CO_SIMULATION, INSTANTIATION_TOKEN);
    Values *v = &arm.state.values;
    v->integrator = count > 1 ? atof(arguments[1]) : 0.0;
    v->relative_tolerance = count > 2 ? atof(arguments[2]) : 1e-9;
    v->kp[0][0] = v->kp[1][1] = 200.0;
    v->kd[0][0] = v->kd[1][1] = 300.0;
    if (count > 3) {
        v->kd[0][0] = v->kd[1][1] = 60.0;
        v->m1 = v->m2 = 0.01;
        v->J1 = v->J2 = 1e-4;
    }
    v->q[0] = 0.4;
    v->qd[1] = -0.7;
    v->disturbance_frequency[0][0] = 1.0;
    v->disturbance_phase[1][0] = 1.5;
    set(&arm, v->disturbance_offset, 2, (double[]){0.3, -0.2});
    v->disturbance_amplitude[0][0] = 2.0;
    v->disturbance_terms[0] = 1.0;
    core_enter_initialization(&arm);
    core_exit_initialization(&arm);
    evaluations = 0;
    double off = 2.0; /* as an estimate's error, which what is heard makes smaller */
    for (int k = 0; k < INTERVALS; ++k, off *= 0.85) {
        set(&arm, v->position_ref, 2, (double[]){0.1 * k + 0.9 * off, -0.05 * k - 0.7 * off});
        set(&arm, v->velocity_ref, 2, (double[]){1.0 - off, off - 0.5});
        set(&arm, &v->reference_time, 1, &v->time);
        core_step(&arm, v->time, 0.1 * (k + 1) - v->time);
        for (int i = 0; i < 2; ++i) {
            print(v->q[i]);
            print(v->qd[i]);
        }
    }
    printf("%ld\n", evaluations);
    return 0;
}
