/* Preloaded into linux.uml (and into nothing that runs inside it): the guest's clock does not count what the host takes away.
 *
 * A busy host holds the guest up for milliseconds to seconds, between any two instructions. Programs in the guest see that as
 * time that has passed without them, and what waits for a frame every 10 ms reports a fault. A hypervisor calls such time
 * stolen and can report it to its guests; User Mode Linux cannot. So here the guest's clock advances with the host's, but
 *
 * - while the guest works, by STEP at most from one look at the clock to the next. A working kernel looks many times in a
 *   millisecond: what lies longer between two looks was a hold-up, or a program that computes, which then merely looks fast;
 * - while the guest sleeps, by STEP at most beyond the moment for which it has set its alarm.
 *
 * It never runs faster than the host's, and never backwards. An alarm that rings early by the guest's clock does no harm: the
 * kernel looks, and sets it again for what is left.
 *
 *     cc -O2 -shared -fPIC -o uml-clock.so uml-clock.c
 */
#define _GNU_SOURCE
#include <limits.h>
#include <signal.h>
#include <stdint.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

#define NEVER INT64_MAX
enum { NS_PER_S = 1000000000, STEP = 100000 /* ns */ };

/* static without a lock: linux.uml is one thread. Its alarm interrupts it, though, so each look blocks all signals. */
static int64_t guest;       /* the guest's clock [ns] */
static int64_t host;        /* the host's at the last look [ns] */
static int64_t due = NEVER; /* when the alarm rings [ns by the guest's clock] */
static volatile sig_atomic_t asleep;

static int64_t nanoseconds(const struct timespec *time)
{
    return (int64_t)time->tv_sec * NS_PER_S + time->tv_nsec;
}

static void look(void)
{
    struct timespec time;
    syscall(SYS_clock_gettime, (long)CLOCK_MONOTONIC, &time);
    const int64_t now = nanoseconds(&time);
    if (host == 0) { /* they begin together */
        guest = host = now;
    }
    int64_t most = STEP;
    if (asleep && due == NEVER) {
        most = NEVER;
    } else if (asleep && due > guest) {
        most += due - guest;
    }
    const int64_t passed = now - host;
    guest += passed < most ? passed : most;
    host = now;
    asleep = 0;
}

static int64_t look_undisturbed(void)
{
    sigset_t all, before;
    sigfillset(&all);
    sigprocmask(SIG_BLOCK, &all, &before);
    look();
    const int64_t now = guest;
    sigprocmask(SIG_SETMASK, &before, NULL);
    return now;
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    if (clock != CLOCK_MONOTONIC) {
        return (int)syscall(SYS_clock_gettime, (long)clock, time);
    }
    const int64_t now = look_undisturbed();
    time->tv_sec = now / NS_PER_S;
    time->tv_nsec = now % NS_PER_S;
    return 0;
}

int timer_settime(timer_t timer, int flags, const struct itimerspec *set, struct itimerspec *before)
{
    const int64_t left = nanoseconds(&set->it_value);
    const int64_t now = look_undisturbed();
    due = left == 0 ? NEVER : now + left;
    return (int)syscall(SYS_timer_settime, (long)(intptr_t)timer, flags, set, before);
}

int sigsuspend(const sigset_t *mask) /* the kernel's only way to sleep */
{
    look_undisturbed();
    asleep = 1;
    const int result = (int)syscall(SYS_rt_sigsuspend, mask, (long)(_NSIG / CHAR_BIT));
    if (asleep) { /* what woke it did not look */
        look_undisturbed();
    }
    return result;
}
