/* One simulated instance, for any FMI version and any model.
 *
 * State holds all that a simulation changes, and no pointer: an FMU state is a copy of
 * it. Each function returns whether it did what was asked; when it did not, it has
 * told the importer why, and left the instance as it was, but for a step. */

#ifndef CORE_H
#define CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "integrator.h"
#include "variables.h"

typedef enum { MODEL_EXCHANGE, CO_SIMULATION } Kind;

/* FMI 2.0.4 sections 3.2.3 and 4.2.4, FMI 3.0.2 section 2.3: disjoint bits, so that
 * a set of modes is their sum. */
typedef enum {
    INSTANTIATED = 1,
    INITIALIZATION = 2,
    EVENT = 4,
    CONTINUOUS_TIME = 8,
    STEP = 16,
    TERMINATED = 32,
    CONFIGURATION = 64
} Mode;

enum {
    NEVER = 0,
    BEFORE_START = INSTANTIATED | INITIALIZATION,
    INITIALIZED = EVENT | CONTINUOUS_TIME | STEP,
    UNTIL_THE_END = BEFORE_START | INITIALIZED,
    ANY_MODE = UNTIL_THE_END | TERMINATED | CONFIGURATION
};

/* How many rows or columns there are: as many as the structural parameter at index `by`
 * of Values says; always `most` where `by` is 0. */
typedef struct {
    size_t most;
    unsigned by;
} Length;

/* By what the number is brought up to date before it is read. */
typedef enum { NOT_CALCULATED, DERIVATIVE, OUTPUT } Calculated;

/* What the importer may do with the number of Values at the same index. */
typedef struct {
    const char *name;
    Length rows, columns; /* of the real variable that begins here; 0 inside of one */
    int settable_in;
    Calculated calculated;
    double min, max;
    unsigned most; /* of a structural parameter; 0 for a real variable */
} Variable;

extern const Variable variables[VALUES];
extern const double start_values[VALUES];

typedef struct {
    char token[sizeof INSTANTIATION_TOKEN]; /* whose state these bytes are */
    Kind kind;
    Mode mode;
    bool derivatives_are_current;
    int jumped; /* 1 if the derivatives are not those at the end of the last step */
    Pace pace;
    double stop; /* s: beyond which nothing is computed; infinite where none is set */
    Values values;
} State;

typedef struct Instance {
    State state;
    bool whole_variables; /* a value reference names an array (FMI 3) or one number (FMI 2) */
    void (*log_error)(const struct Instance *self, const char *message); /* no % in it */
} Instance;

/* Before anything else, on an instance whose two last members are set. */
bool core_instantiate(Instance *self, Kind kind, const char *token);

/* Tells the importer why a call fails; returns false. */
bool core_refuse(const Instance *self, const char *format, ...);

/* Whether a state's numbers name a method of integrator.h's; otherwise refuses. */
bool integrator_is_known(const Instance *self, const Values *values);

/* Whether there is a place for, or of, n numbers or what else is passed; otherwise refuses. */
bool core_given(const Instance *self, const void *place, size_t n);

/* Whether the instance is in one of the modes; otherwise refuses `what`. */
bool core_expect(const Instance *self, int modes, const char *what);

/* Whether a number may be that of a variable; otherwise refuses it. */
bool core_is_within_limits(const Instance *self, const Variable *variable, double value);

bool core_reset(Instance *self);
bool core_start_at(Instance *self, bool tolerance_defined, double tolerance, double start,
                   bool stop_defined, double stop);
bool core_enter_initialization(Instance *self);
bool core_exit_initialization(Instance *self);
bool core_change_mode(Instance *self, int from, Mode to, const char *what);

bool core_get(Instance *self, const unsigned references[], size_t n_references,
              double values[], size_t n_values);
bool core_set(Instance *self, const unsigned references[], size_t n_references,
              const double values[], size_t n_values);

/* Structural parameters. Changing one returns all variables that it sizes to their starts. */
bool core_get_counts(Instance *self, const unsigned references[], size_t n_references,
                     uint64_t counts[], size_t n_counts);
bool core_set_counts(Instance *self, const unsigned references[], size_t n_references,
                     const uint64_t counts[], size_t n_counts);

/* Model exchange. */
bool core_set_time(Instance *self, double time);
bool core_accept_time(Instance *self, int modes, const char *what);
bool core_set_states(Instance *self, const double x[], size_t n);
bool core_get_states(Instance *self, double x[], size_t n);
bool core_get_derivatives(Instance *self, double dx[], size_t n);
bool core_get_nominals(Instance *self, double nominals[], size_t n);

/* What is a whole number of ns, but for rounding of numbers of that size in s, becomes the double
 * next to it, so that masters that add up time and those that count it come to the same bits. */
double snapped(double seconds, double size);

/* Co-simulation: on failure time and states are those of the last accepted internal step. */
bool core_step(Instance *self, double time, double step);

/* saved_state.c. FMU states are blocks of malloc; *state is reused when it is not NULL. */
bool core_get_state(Instance *self, void **state);
bool core_set_state(Instance *self, const void *state);
bool core_free_state(Instance *self, void **state);
bool core_serialize(Instance *self, const void *state, void *bytes, size_t size);
bool core_deserialize(Instance *self, const void *bytes, size_t size, void **state);

#endif
