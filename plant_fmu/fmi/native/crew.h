/* Threads that wait for work, and do it together with the thread that has it.
 *
 * Who has work offers it, takes part, takes it back, and waits for those who are still in it. A
 * helper that has not begun by then is not waited for: on a busy machine it would be worse than none.
 * Before a thread sleeps it looks for a while whether it need not, since to be woken takes longer than
 * the steps of a few robots; no longer, for others want the processor too. */

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#if defined _WIN32
#include <windows.h>
typedef SRWLOCK Lock;
typedef CONDITION_VARIABLE Condition;
#define make_lock InitializeSRWLock
#define make_condition InitializeConditionVariable
#define take AcquireSRWLockExclusive
#define give ReleaseSRWLockExclusive
#define wake_all WakeAllConditionVariable
#define sleep_until(condition, lock) SleepConditionVariableSRW(condition, lock, INFINITE, 0)
#else
#include <pthread.h>
typedef pthread_mutex_t Lock;
typedef pthread_cond_t Condition;
#define make_lock(lock) pthread_mutex_init(lock, NULL)
#define make_condition(condition) pthread_cond_init(condition, NULL)
#define take pthread_mutex_lock
#define give pthread_mutex_unlock
#define wake_all pthread_cond_broadcast
#define sleep_until pthread_cond_wait
#endif

#if defined __x86_64__ || defined __i386__
#define PAUSE() __builtin_ia32_pause()
#elif defined __aarch64__ && defined __GNUC__
#define PAUSE() __asm__ volatile("yield")
#else
#define PAUSE() ((void)0)
#endif

enum { LOOKS = 2000 }; /* of a pause each: some 50 us */

/* A member's part of the work: 0 is who has it. */
typedef void Part(void *work, size_t member);

typedef struct {
    Lock lock;
    Condition offered, left;
    Part *part;
    void *work;
    uint64_t last;    /* piece of work, by number */
    uint64_t offer;   /* its number while it may be begun, otherwise 0 */
    size_t asleep;    /* helpers */
    size_t in_it;     /* helpers */
    bool dismissed;
} Crew;

static Crew *make_crew(void)
{
    Crew *crew = calloc(1, sizeof *crew);
    if (crew) {
        make_lock(&crew->lock);
        make_condition(&crew->offered);
        make_condition(&crew->left);
    }
    return crew;
}

static bool nothing_new(Crew *crew, uint64_t done)
{
    const uint64_t offer = __atomic_load_n(&crew->offer, __ATOMIC_ACQUIRE);
    return (!offer || offer == done) && !__atomic_load_n(&crew->dismissed, __ATOMIC_ACQUIRE);
}

/* Return, with the lock, when there is an offer that is not done, or the crew is dismissed. */
static void await_offer(Crew *crew, uint64_t done)
{
    for (;;) {
        int looks = 0;
        for (; looks < LOOKS && nothing_new(crew, done); ++looks)
            PAUSE();
        take(&crew->lock);
        if (looks == LOOKS && nothing_new(crew, done)) {
            ++crew->asleep;
            sleep_until(&crew->offered, &crew->lock);
            --crew->asleep;
        }
        if (!nothing_new(crew, done))
            return;
        give(&crew->lock);
    }
}

/* Take part as that member until dismissed. */
static void help(Crew *crew, size_t member)
{
    for (uint64_t done = 0;;) {
        await_offer(crew, done);
        if (crew->dismissed)
            break;
        done = crew->offer;
        ++crew->in_it;
        give(&crew->lock);
        crew->part(crew->work, member);
        take(&crew->lock);
        if (!__atomic_sub_fetch(&crew->in_it, 1, __ATOMIC_RELEASE))
            wake_all(&crew->left);
        give(&crew->lock);
    }
    give(&crew->lock);
}

/* Do work with whoever comes; it is done when this returns. */
static void do_together(Crew *crew, Part *part, void *work)
{
    take(&crew->lock);
    crew->part = part, crew->work = work;
    __atomic_store_n(&crew->offer, ++crew->last, __ATOMIC_RELEASE);
    if (crew->asleep)
        wake_all(&crew->offered);
    give(&crew->lock);
    part(work, 0);
    take(&crew->lock);
    __atomic_store_n(&crew->offer, 0, __ATOMIC_RELEASE);
    give(&crew->lock);
    for (int look = 0; look < LOOKS && __atomic_load_n(&crew->in_it, __ATOMIC_ACQUIRE); ++look)
        PAUSE();
    take(&crew->lock);
    while (crew->in_it)
        sleep_until(&crew->left, &crew->lock);
    give(&crew->lock);
}

static void dismiss(Crew *crew)
{
    take(&crew->lock);
    __atomic_store_n(&crew->dismissed, true, __ATOMIC_RELEASE);
    wake_all(&crew->offered);
    give(&crew->lock);
}
