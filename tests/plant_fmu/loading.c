/* Loads a bundled model's library as an importer of its platform does, and steps it.
 *
 * Each of its functions has to be there. It is set by -DSET to -DVALUES, takes 20 steps of 0.05 s,
 * and what -DGET has is printed after each, to the bit. FMI 2.0 or 3.0 for Co-Simulation by -DFMI;
 * -DEACH calls its argument with every name that a library of FMI has.
 *
 *   loading LIBRARY TOKEN */

#include <stdio.h>
#include <stdlib.h>

#ifdef _WIN32
#include <windows.h>
#define OPEN(path) (void *)LoadLibraryA(path)
#define FIND(library, name) (void *)GetProcAddress((HMODULE)library, name)
#else
#include <dlfcn.h>
#define OPEN(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define FIND(library, name) dlsym(library, name)
#endif

#if FMI == 2
#include "fmi2FunctionTypes.h"
#define F(name) fmi2##name##TYPE *
#define NAMED(name) "fmi2" name
#else
#include "fmi3FunctionTypes.h"
#define F(name) fmi3##name##TYPE *
#define NAMED(name) "fmi3" name
#endif
#define CALL(name) ((F(name))found(library, NAMED(#name)))

static void *found(void *library, const char *name)
{
    void *function = FIND(library, name);
    if (function == NULL) {
        printf("no %s\n", name);
        exit(1);
    }
    return function;
}

static void expect(int good, const char *what)
{
    if (!good) {
        printf("%s failed\n", what);
        exit(1);
    }
}

static const unsigned set[] = SET, get[] = GET;
static double values[] = VALUES, numbers[sizeof values / sizeof *values];
enum { STEPS = 20, COUNT = sizeof values / sizeof *values };
#define LENGTH(array) (sizeof array / sizeof *array)

int main(int count, char **arguments)
{
    expect(count == 3, "its arguments");
    void *library = OPEN(arguments[1]), *robot;
    expect(library != NULL, "loading");
#define FOUND(name) found(library, name);
    EACH(FOUND)
#if FMI == 2
    const fmi2CallbackFunctions given = {NULL, calloc, free, NULL, NULL};
    robot = CALL(Instantiate)("robot", fmi2CoSimulation, arguments[2], "", &given, 0, 0);
    expect(robot && CALL(SetupExperiment)(robot, 0, 0.0, 0.0, 0, 0.0) == 0, "its instance");
    expect(CALL(EnterInitializationMode)(robot) == 0, "its initialisation");
    expect(CALL(SetReal)(robot, set, LENGTH(set), values) == 0, "setting");
#else
    robot = CALL(InstantiateCoSimulation)("robot", arguments[2], "", 0, 0, 0, 0, NULL, 0, NULL,
                                          NULL, NULL);
    expect(robot && CALL(EnterInitializationMode)(robot, 0, 0.0, 0.0, 0, 0.0) == 0, "its instance");
    expect(CALL(SetFloat64)(robot, set, LENGTH(set), values, COUNT) == 0, "setting");
#endif
    expect(CALL(ExitInitializationMode)(robot) == 0, "its initialisation");
    for (int k = 0; k < STEPS; ++k) {
#if FMI == 2
        expect(CALL(DoStep)(robot, k * 0.05, 0.05, 1) == 0, "a step");
        expect(CALL(GetReal)(robot, get, LENGTH(get), numbers) == 0, "getting");
#else
        fmi3Boolean event, ends, early;
        double last;
        expect(CALL(DoStep)(robot, k * 0.05, 0.05, 1, &event, &ends, &early, &last) == 0, "a step");
        expect(CALL(GetFloat64)(robot, get, LENGTH(get), numbers, COUNT) == 0, "getting");
#endif
        for (int i = 0; i < COUNT; ++i)
            printf("%.17g\n", numbers[i]);
    }
    CALL(FreeInstance)(robot);
    return 0;
}
