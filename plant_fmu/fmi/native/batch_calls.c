/* One call asks every instance of an FMU the same, in the order of their rows:
 *
 *   exchange  to set, or to get, its row of numbers
 *   advance   to step, and then to get its row of numbers
 *   recall    to keep, or to go back to, its state
 *
 * A crew of threads may advance together: each takes block after block of rows, until there is no
 * other. Rows do not depend on one another, so that it does not matter who takes which.
 *
 * The first call whose status is neither OK nor a warning ends the round: after fmi3Fatal
 * no instance may be called (FMI 3.0, section 2.3). Then no further block is taken, and those before
 * it are, so that of all rows that ended it the first is the same however many threads there are.
 * Each call is announced before it is made, by each thread where it alone writes; and the thread in
 * which the process ends says so there, if it still can. */

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "crew.h"
#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#if defined _WIN32
#define EXPORTED __declspec(dllexport)
#elif defined __GNUC__
#define EXPORTED __attribute__((visibility("default")))
#else
#define EXPORTED
#endif

/* As plant_fmu/fmi/calls.py has them. */
enum { OK = 0, WARNING = 1, ENDED = 6, EARLY = 7 };

/* As plant_fmu/isolation/progress.py has it. */
enum { WHO = 32, ACT = 24 };

typedef struct {
    uint64_t count;
    char who[WHO], act[ACT];
    double start; /* of the last step, s */
    uint64_t ended;
} Progress;

/* Of the call that ended a round, the last one otherwise. */
typedef struct {
    int status;
    bool stepping;
} Answer;

struct Member;

/* As one thread calls them. */
typedef struct {
    size_t n;
    void *const *instances;
    Progress *progress; /* NULL where nobody wants to know */
    const char *names;  /* of the instances, as they stand in the Progress, one after another */
    Crew *crew;         /* NULL where nobody helps this thread */
    size_t n_members;
    struct Member *members; /* of the crew: this thread, and its helpers */
} Instances;

typedef struct Member {
    const Instances *all;
    size_t reached; /* the row whose call ended the round, n when none of this thread's did */
    Answer answer;
} Member;

typedef void Function(void);

typedef struct {
    int fmi; /* 2 or 3 */
    Function *set, *get, *step, *get_state, *set_state;
} Calls;

/* Row i is n_values numbers from values + i * stride. */
typedef struct {
    const unsigned *references;
    size_t n_references;
    double *values;
    size_t n_values, stride;
} Rows;

/* What threads that advance together do. */
typedef struct {
    const Calls *calls;
    Member *members;
    const Rows *rows;
    double start, length;
    size_t next; /* the first row that nobody has taken yet */
    bool ended;  /* by a call */
} Round;

enum { BLOCK = 4 };

static __thread Progress *announced; /* where this thread announced its last call */

static void say_ended(void)
{
    if (announced && announced->act[0])
        announced->ended = 1;
}

static void on_signal(int number)
{
    say_ended();
    signal(number, SIG_DFL);
    raise(number);
}

EXPORTED void watch_endings(void)
{
    static const int NUMBERS[] = {SIGABRT, SIGFPE, SIGILL, SIGSEGV,
#ifdef SIGBUS
                                  SIGBUS,
#endif
    };
    atexit(say_ended);
    for (size_t i = 0; i < sizeof NUMBERS / sizeof *NUMBERS; ++i)
        signal(NUMBERS[i], on_signal);
}

static const char SET[ACT] = "set";
static const char GET[ACT] = "get";
static const char STEP[ACT] = "step";

static void announce(const Instances *all, size_t row, const char *act)
{
    Progress *progress = all->progress;
    if (!progress)
        return;
    memcpy(progress->who, all->names + row * WHO, WHO);
    memcpy(progress->act, act, ACT);
    ++progress->count;
    announced = progress;
}

/* A thread that has nothing more to do is in no call, however long the others take. */
static void rest(const Instances *all)
{
    if (!all->progress)
        return;
    memset(all->progress->who, 0, WHO);
    memset(all->progress->act, 0, ACT);
}

static bool is_fine(int status)
{
    return status == OK || status == WARNING;
}

static int set(const Calls *calls, const Instances *all, const Rows *rows, size_t row)
{
    const double *values = rows->values + row * rows->stride;
    announce(all, row, SET);
    if (calls->fmi == 2)
        return (int)((fmi2SetRealTYPE *)calls->set)(all->instances[row], rows->references,
                                                    rows->n_references, values);
    return (int)((fmi3SetFloat64TYPE *)calls->set)(all->instances[row], rows->references,
                                                   rows->n_references, values, rows->n_values);
}

static int get(const Calls *calls, const Instances *all, const Rows *rows, size_t row)
{
    double *values = rows->values + row * rows->stride;
    announce(all, row, GET);
    if (calls->fmi == 2)
        return (int)((fmi2GetRealTYPE *)calls->get)(all->instances[row], rows->references,
                                                    rows->n_references, values);
    return (int)((fmi3GetFloat64TYPE *)calls->get)(all->instances[row], rows->references,
                                                   rows->n_references, values, rows->n_values);
}

static int step(const Calls *calls, const Instances *all, size_t row, double start, double length)
{
    bool event = false, ended = false, early = false;
    double reached = start;
    if (all->progress)
        all->progress->start = start;
    announce(all, row, STEP);
    if (calls->fmi == 2)
        return (int)((fmi2DoStepTYPE *)calls->step)(all->instances[row], start, length, fmi2True);
    const int status = (int)((fmi3DoStepTYPE *)calls->step)(
        all->instances[row], start, length, fmi3True, &event, &ended, &early, &reached);
    if (status <= WARNING && (ended || early))
        return ended ? ENDED : EARLY;
    return status;
}

static int keep(const Calls *calls, const Instances *all, void **state, size_t row)
{
    announce(all, row, GET);
    if (calls->fmi == 2)
        return (int)((fmi2GetFMUstateTYPE *)calls->get_state)(all->instances[row], state);
    return (int)((fmi3GetFMUStateTYPE *)calls->get_state)(all->instances[row], state);
}

static int go_back(const Calls *calls, const Instances *all, void *state, size_t row)
{
    announce(all, row, SET);
    if (calls->fmi == 2)
        return (int)((fmi2SetFMUstateTYPE *)calls->set_state)(all->instances[row], state);
    return (int)((fmi3SetFMUStateTYPE *)calls->set_state)(all->instances[row], state);
}

/* These return the row whose call ended the round, n when none did. */

EXPORTED size_t exchange(const Calls *calls, const Instances *all, const Rows *rows, bool setting,
                         Answer *answer)
{
    size_t row = 0;
    *answer = (Answer){OK, false};
    for (; row < all->n; ++row) {
        answer->status = setting ? set(calls, all, rows, row) : get(calls, all, rows, row);
        if (!is_fine(answer->status))
            break;
    }
    return row;
}

static size_t advance_some(const Calls *calls, const Instances *all, const Rows *rows,
                           double start, double length, size_t row, size_t end, Answer *answer)
{
    for (; row < end; ++row) {
        *answer = (Answer){step(calls, all, row, start, length), true};
        if (!is_fine(answer->status))
            break;
        *answer = (Answer){get(calls, all, rows, row), false};
        if (!is_fine(answer->status))
            break;
    }
    return row;
}

static void take_blocks(void *work, size_t number)
{
    Round *round = work;
    Member *member = &round->members[number];
    const Instances *all = member->all;
    member->answer = (Answer){OK, false};
    while (!__atomic_load_n(&round->ended, __ATOMIC_SEQ_CST)) {
        const size_t first = __atomic_fetch_add(&round->next, BLOCK, __ATOMIC_SEQ_CST);
        if (first >= all->n)
            break;
        const size_t end = all->n - first < BLOCK ? all->n : first + BLOCK;
        const size_t row = advance_some(round->calls, all, round->rows, round->start,
                                        round->length, first, end, &member->answer);
        if (row < end) {
            __atomic_store_n(&round->ended, true, __ATOMIC_SEQ_CST);
            member->reached = row;
            break;
        }
    }
    rest(all);
}

EXPORTED size_t advance(const Calls *calls, const Instances *all, const Rows *rows, double start,
                        double length, Answer *answer)
{
    *answer = (Answer){OK, false};
    if (!all->crew)
        return advance_some(calls, all, rows, start, length, 0, all->n, answer);
    size_t reached = all->n;
    Round round = {calls, all->members, rows, start, length, 0, false};
    for (size_t i = 0; i < all->n_members; ++i)
        all->members[i].reached = reached;
    do_together(all->crew, take_blocks, &round);
    for (const Member *member = all->members; member < all->members + all->n_members; ++member) {
        if (member->reached < reached) {
            reached = member->reached;
            *answer = member->answer;
        }
    }
    return reached;
}

EXPORTED size_t recall(const Calls *calls, const Instances *all, void *states[], bool keeping,
                       Answer *answer)
{
    size_t row = 0;
    *answer = (Answer){OK, false};
    for (; row < all->n; ++row) {
        answer->status = keeping ? keep(calls, all, &states[row], row)
                                 : go_back(calls, all, states[row], row);
        if (!is_fine(answer->status))
            break;
    }
    return row;
}

/* The members of a crew are threads of Python. */

EXPORTED Crew *begin_crew(void)
{
    return make_crew();
}

EXPORTED void help_crew(Crew *crew, size_t member)
{
    help(crew, member);
}

EXPORTED void dismiss_crew(Crew *crew)
{
    dismiss(crew);
}

/* When all helpers are gone. */
EXPORTED void end_crew(Crew *crew)
{
    free(crew);
}
