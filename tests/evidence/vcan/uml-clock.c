/* Preloaded into linux.uml, not into programs that run inside it: the guest's clock does not count stolen time.
 *
 * A busy host can stop the guest for milliseconds to seconds between any two instructions. Programs in the guest see this as
 * time that has passed without them, and a program that waits for a frame every 10 ms reports a fault. A hypervisor calls such
 * time stolen and can report it to its guests; User Mode Linux cannot. Here the guest's clock advances with the host's, with two
 * limits:
 *
 * - While the guest works, by at most STEP between two readings of the clock. A working kernel reads it many times per
 *   millisecond. A longer interval was stolen, or a program computed, which then merely appears fast.
 * - While the guest sleeps, by at most STEP beyond the time of its alarm.
 *
 * It never runs faster than the host's clock, and never backwards. An alarm that is early by the guest's clock does no harm: the
 * kernel reads the clock and sets the alarm again for the rest.
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

/* No lock: linux.uml has one thread. Its alarm interrupts it, so each reading blocks all signals. */
static int64_t guest;       /* the guest's clock [ns] */
static int64_t host;        /* the host's clock at the last reading [ns] */
static int64_t due = NEVER; /* time of the alarm [ns of the guest's clock] */
static volatile sig_atomic_t asleep;

static int64_t nanoseconds(const struct timespec *time)
{
    return (int64_t)time->tv_sec * NS_PER_S + time->tv_nsec;
}

static void read_clock(void)
{
    struct timespec time;
    syscall(SYS_clock_gettime, (long)CLOCK_MONOTONIC, &time);
    const int64_t now = nanoseconds(&time);
    if (host == 0) { /* both clocks start together */
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

static int64_t read_blocking_signals(void)
{
    sigset_t all, before;
    sigfillset(&all);
    sigprocmask(SIG_BLOCK, &all, &before);
    read_clock();
    const int64_t now = guest;
    sigprocmask(SIG_SETMASK, &before, NULL);
    return now;
}

int clock_gettime(clockid_t clock, struct timespec *time)
{
    if (clock != CLOCK_MONOTONIC) {
        return (int)syscall(SYS_clock_gettime, (long)clock, time);
    }
    const int64_t now = read_blocking_signals();
    time->tv_sec = now / NS_PER_S;
    time->tv_nsec = now % NS_PER_S;
    return 0;
}

int timer_settime(timer_t timer, int flags, const struct itimerspec *set, struct itimerspec *before)
{
    const int64_t left = nanoseconds(&set->it_value);
    const int64_t now = read_blocking_signals();
    due = left == 0 ? NEVER : now + left;
    return (int)syscall(SYS_timer_settime, (long)(intptr_t)timer, flags, set, before);
}

int sigsuspend(const sigset_t *mask) /* the kernel's only way to sleep */
{
    read_blocking_signals();
    asleep = 1;
    const int result = (int)syscall(SYS_rt_sigsuspend, mask, (long)(_NSIG / CHAR_BIT));
    if (asleep) { /* the waking signal did not read the clock */
        read_blocking_signals();
    }
    return result;
}
