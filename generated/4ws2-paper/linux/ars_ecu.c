/*
 * The ECU as a Linux program on SocketCAN: the cyclic task with a timer and a raw CAN socket.
 *
 * With the timer, the task runs once a period at absolute deadlines, half a period after the car's frames. Late runs are counted;
 * missed periods are skipped, not repeated. In lock-step there is no timer: the task runs once for each complete set of the car's
 * frames.
 *
 * With --xcp a master can measure and calibrate over XCP on CAN (ars_xcp.h) between two runs of the task. Without it the
 * calibration is read-only.
 *
 * Prints "ready" when it can receive. While the interface is down or removed, the task continues to run, and communication resumes
 * when the interface is back. SIGTERM and SIGINT end the program with a line of counters on standard error.
 *
 * C99, POSIX.1-2008, and of Linux: SocketCAN, timerfd, signalfd. No heap.
 *
 * This file is the same in every build; ars_ecu_config.h holds what differs.
 */
#define _POSIX_C_SOURCE 200809L

#ifndef __linux__
#error "SocketCAN is a part of Linux"
#endif

#include <ctype.h>
#include <errno.h>
#include <inttypes.h>
#include <limits.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <signal.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/signalfd.h>
#include <sys/socket.h>
#include <sys/timerfd.h>
#include <sys/types.h>
#include <time.h>
#include <unistd.h>

#include "ars_ecu_config.h"
#include "ars_xcp.h"

enum {
    EXIT_BAD_INPUT = 2,
    SILENCE_PERIODS = 4,        /* periods without a frame of the car until the timer is synchronised again */
    FRAMES_AT_ONCE_MAX = 256,   /* frames read before the timer is checked again, even on a flooded bus */
    COMMANDS_AT_ONCE_MAX = 4,   /* commands of a master handled before the timer is checked again */
    SLIP_WEIGHT = 10,           /* weight of a run with two sets or none, relative to a run in phase */
    SLIPPING_MAX = 25,          /* level of slips above which the timer is synchronised again */
    RECEIVE_BUFFER = 1 << 20    /* bytes; the kernel may give less */
};

static const int64_t second = INT64_C(1000000000);          /* all times are in ns */
static const int64_t period = ARS_ECU_PERIOD_NS;
static const int64_t watch_period = INT64_C(100000000);     /* period of the checks for a lost interface and for the parent */

typedef struct {
    const char *interface;
    bool lock_step;
    bool xcp;                   /* measurement and calibration are enabled */
    int priority;               /* priority of SCHED_FIFO; 0: normal scheduling */
    pid_t parent;               /* the program ends when this is no longer its parent; 0: not checked */
} options_t;

typedef struct {
    options_t options;
    ars_task_t task;
    ars_xcp_t xcp;
    int bus;                    /* file descriptor; -1 while the interface is missing */
    int master;                 /* second socket, for XCP; -1 also without XCP */
    int timer;                  /* timer of the task; not started in lock-step */
    int watch;
    int signals;
    int64_t deadline;           /* time of the task's next run */
    bool in_phase;              /* timer is synchronised with the frames of the car */
    bool heard;                 /* a frame of the car was received since the last run */
    uint32_t silent_periods;
    uint32_t slips;             /* runs with two sets or none */
    uint32_t slipping;          /* level of recent slips */
    uint32_t late;              /* runs a period or more after their deadline */
    uint32_t runs;              /* runs by the timer */
    int64_t lateness_sum;       /* sum over the runs by the timer */
    int64_t lateness_max;
    uint32_t discarded;         /* frames that were too old */
    uint32_t sent;
    uint32_t send_errors;
    uint32_t lost_packets;      /* XCP packets that could not be sent */
} ecu_t;

static ecu_t ecu;

/* Both are null where the calibration has no section of its own. */
extern uint8_t ARS_ECU_CALIBRATION_START[] __attribute__((weak));
extern uint8_t ARS_ECU_CALIBRATION_STOP[] __attribute__((weak));

/* Largest calibration, with a margin for padding by the linker. */
enum { CALIBRATION_MAX = 1024 + ARS_ECU_CALIBRATION_SIZE };

static uint8_t working_page[CALIBRATION_MAX];
static uint8_t reference_page[CALIBRATION_MAX];

/* Print an error on standard error. Returns the exit code. */
static int refuse(const char *where, const char *what, const char *remedy)
{
    (void)fprintf(stderr, "error: %s: %s%s%s\n", where, what, (remedy[0] != '\0') ? "; " : "", remedy);
    return EXIT_BAD_INPUT;
}

/* --- the clock ---------------------------------------------------------------------------------------------------- */

static int64_t now(void)
{
    struct timespec time;

    (void)clock_gettime(CLOCK_MONOTONIC, &time);
    return ((int64_t)time.tv_sec * second) + (int64_t)time.tv_nsec;
}

static struct timespec timespec_of(int64_t time)
{
    struct timespec result;

    result.tv_sec = (time_t)(time / second);
    result.tv_nsec = (long)(time % second);
    return result;
}

/* Start a timer: first expiration at a point in time, then one in each interval. Unread expirations are discarded. */
static void start_timer(int timer, int64_t first, int64_t interval)
{
    struct itimerspec setting;

    setting.it_value = timespec_of(first);
    setting.it_interval = timespec_of(interval);
    (void)timerfd_settime(timer, TFD_TIMER_ABSTIME, &setting, NULL);
}

/* Number of expirations since the timer was last read or started. */
static uint64_t read_timer(int timer)
{
    uint64_t expirations = 0u;

    return (read(timer, &expirations, sizeof expirations) == (ssize_t)sizeof expirations) ? expirations : 0u;
}

static void start_task_timer(ecu_t *self, int64_t first)
{
    self->deadline = first;
    start_timer(self->timer, first, period);
}

/* --- the bus ------------------------------------------------------------------------------------------------------ */

/* Open a socket that receives two messages only: no remote, error or 29-bit frames, and none of its own. The interface may be down.
 * Returns -1 and sets errno on failure; ENODEV: no such interface, or not a CAN interface. */
static int open_socket(const char *interface, uint32_t one, uint32_t other)
{
    const canid_t exact = CAN_SFF_MASK | CAN_EFF_FLAG | CAN_RTR_FLAG;
    const struct can_filter filters[2] = { { (canid_t)one, exact }, { (canid_t)other, exact } };
    const int size = RECEIVE_BUFFER;
    const unsigned int index = if_nametoindex(interface);
    struct sockaddr_can address;
    int bus = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);

    if (bus < 0) {
        return -1;
    }
    (void)setsockopt(bus, SOL_SOCKET, SO_RCVBUF, &size, sizeof size);
    (void)memset(&address, 0, sizeof address);
    address.can_family = AF_CAN;
    address.can_ifindex = (int)index;
    errno = ENODEV;
    if ((index == 0u) /* for bind(), zero means every interface */
        || (setsockopt(bus, SOL_CAN_RAW, CAN_RAW_FILTER, filters, sizeof filters) != 0)
        || (bind(bus, (const struct sockaddr *)&address, sizeof address) != 0)) {
        const int error = errno;

        (void)close(bus);
        errno = error;
        bus = -1;
    }
    return bus;
}

/* Open the socket for the messages of the car. */
static int open_bus(const char *interface)
{
    return open_socket(interface, (uint32_t)ARS_CAN_ID_VEHICLE_MOTION, (uint32_t)ARS_CAN_ID_VEHICLE_CONDITIONS);
}

/* Open the socket for commands of a master. A separate queue, so that frames of the car never wait behind them. */
static int open_master(const char *interface)
{
    return open_socket(interface, (uint32_t)ARS_XCP_ID_RECEIVE, (uint32_t)ARS_XCP_ID_RECEIVE);
}

/* Print why the bus could not be opened. Returns the exit code. */
static int refuse_bus(const char *interface, int error)
{
    if ((error == EAFNOSUPPORT) || (error == EPROTONOSUPPORT)) {
        return refuse(interface, "this kernel has no SocketCAN", "load it: sudo modprobe -a can_raw vcan");
    }
    if ((error == ENODEV) && (if_nametoindex(interface) != 0u)) {
        return refuse(interface, "not a CAN interface", "");
    }
    if (error == ENODEV) {
        char remedy[160];

        (void)snprintf(remedy, sizeof remedy, "make one: sudo ip link add dev %s type vcan && sudo ip link set up %s",
            interface, interface);
        return refuse(interface, "no such CAN interface", remedy);
    }
    return refuse(interface, strerror(error), "");
}

/* Handle a failed call on a socket. It is kept while the interface is down or its queue is full, and closed otherwise. */
static void note_bus_error(int *bus, int error)
{
    switch (error) {
    case EAGAIN:
    case EINTR:
    case ENETDOWN:
    case ENOBUFS:
        break;
    default: /* ENODEV, ENXIO: the interface was removed */
        (void)close(*bus);
        *bus = -1;
        break;
    }
}

/* --- XCP ---------------------------------------------------------------------------------------------------------- */

static void send_packet(ecu_t *self, const ars_xcp_packet_t *packet)
{
    struct can_frame frame;

    (void)memset(&frame, 0, sizeof frame);
    frame.can_id = (canid_t)ARS_XCP_ID_TRANSMIT;
    frame.can_dlc = packet->length;
    (void)memcpy(frame.data, packet->data, packet->length);
    if (self->master < 0) {
        self->lost_packets++;
    } else if (write(self->master, &frame, sizeof frame) != (ssize_t)sizeof frame) {
        self->lost_packets++;
        note_bus_error(&self->master, errno);
    } else {
        /* sent */
    }
}

/* Send the measurements of a run of the task. */
static void measure(ecu_t *self)
{
    static ars_xcp_packet_t packets[ARS_XCP_ODT_MAX];

    if (self->options.xcp) {
        const uint8_t count = ars_xcp_event(&self->xcp, packets);
        uint8_t k;

        for (k = 0u; k < count; k++) {
            send_packet(self, &packets[k]);
        }
    }
}

/* Answer pending commands of a master. */
static void obey(ecu_t *self)
{
    ars_xcp_packet_t answer;
    struct can_frame frame;
    int commands;

    for (commands = 0; (self->master >= 0) && (commands < COMMANDS_AT_ONCE_MAX); commands++) {
        const ssize_t size = read(self->master, &frame, sizeof frame);

        if (size < 0) {
            note_bus_error(&self->master, errno);
            break;
        }
        if ((size == (ssize_t)sizeof frame) && ars_xcp_command(&self->xcp, frame.data, frame.can_dlc, &answer)) {
            send_packet(self, &answer);
        }
    }
}

static bool is_calibration_valid(void)
{
    return ars_parameters_valid(&ars_parameters_default);
}

/* Start XCP: make the memory pages of the calibration writable. Returns an exit code on failure, otherwise -1. */
static int start_xcp(ecu_t *self)
{
    const uintptr_t start = (uintptr_t)ARS_ECU_CALIBRATION_START;
    const uintptr_t stop = (uintptr_t)ARS_ECU_CALIBRATION_STOP;
    const uintptr_t task = (uintptr_t)&self->task;
    const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE);
    const uintptr_t first = start - (start % page);
    ars_xcp_setup_t setup;

    if ((stop <= start) || ((stop - start) > (uintptr_t)CALIBRATION_MAX)) {
        return refuse("--xcp", "the calibration has no section of its own", "compile as the head of ars_xcp.h says");
    }
    if (((uint64_t)stop > UINT32_MAX) || (((uint64_t)task + sizeof self->task) > UINT32_MAX)) {
        return refuse("--xcp", "the addresses do not fit the 32 bits of XCP", "link with -no-pie");
    }
    if (mprotect(&ARS_ECU_CALIBRATION_START[0] - (start - first), (size_t)(stop - first), PROT_READ | PROT_WRITE) != 0) {
        return refuse("--xcp", strerror(errno), "the calibration cannot be made writable");
    }
    setup.calibration = ARS_ECU_CALIBRATION_START;
    setup.working = working_page;
    setup.reference = reference_page;
    setup.measurements = (const uint8_t *)&self->task;
    setup.calibration_address = (uint32_t)start;
    setup.calibration_size = (uint32_t)(stop - start);
    setup.measurements_address = (uint32_t)task;
    setup.measurements_size = (uint32_t)sizeof self->task;
    setup.is_valid = is_calibration_valid;
    ars_xcp_init(&self->xcp, &setup);
    return -1;
}

/* --- the task ----------------------------------------------------------------------------------------------------- */

/* Run the task and send its frame. A frame that cannot be sent at once is dropped, because the next one is newer. */
static void answer(ecu_t *self)
{
    struct can_frame frame;

    (void)memset(&frame, 0, sizeof frame);
    frame.can_id = ARS_ECU_RUN_TASK(&self->task, frame.data);
    frame.can_dlc = (uint8_t)ARS_CAN_LENGTH;
    if (self->bus < 0) {
        self->send_errors++;
    } else if (write(self->bus, &frame, sizeof frame) == (ssize_t)sizeof frame) {
        self->sent++;
    } else {
        self->send_errors++;
        note_bus_error(&self->bus, errno);
    }
    measure(self);
}

/* Process a frame of the car. In lock-step, a complete set runs the task. With the timer, the first complete set synchronises it. */
static void take(ecu_t *self, const struct can_frame *frame)
{
    self->heard = true;
    ars_task_on_can_frame(&self->task, frame->can_id, frame->data, frame->can_dlc);
    if (!ars_task_is_complete(&self->task)) {
        return;
    }
    if (self->options.lock_step) {
        answer(self);
    } else if (!self->in_phase) {
        self->in_phase = true;
        start_task_timer(self, now() + (period / 2));
    } else {
        /* the timer runs the task */
    }
}

/* Process pending frames of the bus. */
static void receive(ecu_t *self)
{
    struct can_frame frame;
    int frames;

    for (frames = 0; (self->bus >= 0) && (frames < FRAMES_AT_ONCE_MAX); frames++) {
        const ssize_t size = read(self->bus, &frame, sizeof frame);

        if (size < 0) {
            note_bus_error(&self->bus, errno);
            break;
        }
        if (size == (ssize_t)sizeof frame) {
            take(self, &frame);
        }
    }
}

/* Discard pending frames after a pause longer than the tolerated missing samples: they are in sequence, but too old to steer by. */
static void discard(ecu_t *self)
{
    struct can_frame frame;

    while ((self->bus >= 0) && (read(self->bus, &frame, sizeof frame) >= 0)) {
        self->discarded++;
    }
}

/* --- what happens by time ----------------------------------------------------------------------------------------- */

static void measure_lateness(ecu_t *self, uint64_t expirations)
{
    const int64_t lateness = now() - self->deadline;

    self->deadline += (int64_t)expirations * period;
    self->runs++;
    self->lateness_sum += lateness;
    if (lateness > self->lateness_max) {
        self->lateness_max = lateness;
    }
    if (expirations > 1u) {
        self->late++;
    }
}

/* Repeated runs with two sets or none mean that the frames of the car arrive just when the timer expires. Synchronise again then. */
static void watch_phase(ecu_t *self)
{
    const uint32_t slips = self->task.late_cycles + self->task.early_cycles;

    if (slips != self->slips) {
        self->slips = slips;
        self->slipping += (uint32_t)SLIP_WEIGHT;
    } else if (self->slipping > 0u) {
        self->slipping--;
    } else {
        /* well in phase */
    }
    if (self->slipping > (uint32_t)SLIPPING_MAX) {
        self->slipping = 0u;
        self->in_phase = false;
    }
}

static void on_timer(ecu_t *self, uint64_t expirations)
{
    measure_lateness(self, expirations);
    answer(self);
    watch_phase(self);
    self->silent_periods = self->heard ? 0u : (self->silent_periods + 1u);
    self->heard = false;
    if (self->silent_periods >= (uint32_t)SILENCE_PERIODS) {
        self->in_phase = false;
    }
}

/* Reopen lost sockets. Returns whether to continue. */
static bool on_watch(ecu_t *self)
{
    (void)read_timer(self->watch);
    if (self->bus < 0) {
        self->bus = open_bus(self->options.interface);
    }
    if (self->options.xcp && (self->master < 0)) {
        self->master = open_master(self->options.interface);
    }
    return (self->options.parent == 0) || (getppid() == self->options.parent);
}

/* --- the program -------------------------------------------------------------------------------------------------- */

/* Read the bus first: the task needs the newest frames, and a first set moves the timer. */
static void wake(ecu_t *self, uint64_t expirations)
{
    const bool was_in_phase = self->in_phase;

    if (expirations > ((uint64_t)self->task.parameters->inputs.missing_samples_max + 1u)) {
        discard(self);
    } else {
        receive(self);
    }
    if ((expirations > 0u) && (was_in_phase || !self->in_phase)) {
        on_timer(self, expirations);
    }
}

/* Run until a signal arrives. */
static void serve(ecu_t *self)
{
    enum { SIGNALS, TIMER, WATCH, BUS, MASTER, WAITING };
    struct pollfd waiting[WAITING] = {
        [SIGNALS] = { .fd = self->signals, .events = POLLIN },
        [TIMER] = { .fd = self->timer, .events = POLLIN },
        [WATCH] = { .fd = self->watch, .events = POLLIN },
        [BUS] = { .fd = self->bus, .events = POLLIN },
        [MASTER] = { .fd = self->master, .events = POLLIN }
    };
    bool running = true;

    while (running) {
        waiting[BUS].fd = self->bus; /* poll() skips -1 */
        waiting[MASTER].fd = self->master;
        if (poll(waiting, (nfds_t)WAITING, -1) < 0) {
            continue; /* stopped and continued */
        }
        wake(self, (waiting[TIMER].revents != 0) ? read_timer(self->timer) : 0u);
        obey(self);
        running = (waiting[WATCH].revents == 0) || on_watch(self);
        running = running && (waiting[SIGNALS].revents == 0);
    }
}

/* Open SIGTERM and SIGINT as a file descriptor, so that none is missed between two polls. */
static int open_signals(void)
{
    sigset_t stopping;

    (void)sigemptyset(&stopping);
    (void)sigaddset(&stopping, SIGTERM);
    (void)sigaddset(&stopping, SIGINT);
    (void)sigprocmask(SIG_BLOCK, &stopping, NULL);
    return signalfd(-1, &stopping, SFD_NONBLOCK | SFD_CLOEXEC);
}

static bool open_all(ecu_t *self)
{
    self->signals = open_signals();
    self->timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    self->watch = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
    return (self->signals >= 0) && (self->timer >= 0) && (self->watch >= 0);
}

/* Set real-time priority and lock all memory; 0 changes nothing. Returns whether that succeeded. */
static bool set_priority(int priority)
{
    struct sched_param parameter;

    (void)memset(&parameter, 0, sizeof parameter);
    parameter.sched_priority = priority;
    return (priority == 0)
        || ((sched_setscheduler(0, SCHED_FIFO, &parameter) == 0) && (mlockall(MCL_CURRENT | MCL_FUTURE) == 0));
}

static void print_counters(const ecu_t *self)
{
    const ars_task_t *task = &self->task;
    const int64_t mean = (self->runs > 0u) ? (self->lateness_sum / (int64_t)self->runs) : 0;

    (void)fprintf(stderr,
        "cycles=%" PRIu32 " late=%" PRIu32 " late_samples=%" PRIu32 " early_samples=%" PRIu32 " lost_samples=%" PRIu32
        " discarded=%" PRIu32 " sent=%" PRIu32 " send_errors=%" PRIu32
        " lateness_mean_us=%" PRId64 " lateness_max_us=%" PRId64,
        task->cycles, self->late, task->late_cycles, task->early_cycles, task->lost_samples,
        self->discarded, self->sent, self->send_errors, mean / 1000, self->lateness_max / 1000);
    if (self->options.xcp) {
        (void)fprintf(stderr, " lost_packets=%" PRIu32, self->lost_packets);
    }
    (void)fprintf(stderr, "\n");
}

static int run(ecu_t *self)
{
    int code = -1;

    self->master = -1;
    if (!ars_selftest()) {
        (void)fprintf(stderr, "error: the self-test failed; build and compile again\n");
        return EXIT_FAILURE;
    }
    if (!open_all(self)) {
        return refuse("timers and signals", strerror(errno), "");
    }
    if (!set_priority(self->options.priority)) {
        return refuse("--priority", strerror(errno), "run it as root, or with the capabilities cap_sys_nice and cap_ipc_lock");
    }
    if (self->options.xcp) {
        code = start_xcp(self);
    }
    if (code >= 0) {
        return code;
    }
    self->bus = open_bus(self->options.interface);
    if (self->options.xcp && (self->bus >= 0)) {
        self->master = open_master(self->options.interface);
    }
    if ((self->bus < 0) || (self->options.xcp && (self->master < 0))) {
        return refuse_bus(self->options.interface, errno);
    }
    ars_task_init(&self->task, &ars_parameters_default);
    (void)printf("ready\n");
    (void)fflush(stdout);
    start_timer(self->watch, now() + watch_period, watch_period);
    if (!self->options.lock_step) {
        start_task_timer(self, now() + period);
    }
    serve(self);
    print_counters(self);
    return EXIT_SUCCESS;
}

static void print_help(void)
{
    (void)printf(
        "usage: ars_ecu [--lock-step] [--xcp] [--priority N] [--parent PID] INTERFACE\n\n"
        "The rear-steering ECU of this build on a CAN interface, say vcan0, every " ARS_ECU_PERIOD_TEXT ".\n\n"
        "  --lock-step    no timer: answer each complete set of the car's frames once\n"
        "  --xcp          let a master measure and calibrate: XCP on CAN, identifiers " ARS_XCP_IDS_TEXT "\n"
        "  --priority N   real-time priority (SCHED_FIFO) 1 to 99, all memory locked\n"
        "  --parent PID   end where process PID is no longer the parent\n"
        "  -h, --help     this text\n\n"
        "Exit codes: 0 ended by SIGTERM or SIGINT, 1 the self-test failed, 2 bad input.\n");
}

/* Return a decimal number from 1 to high, or -1. */
static int number_of(const char *text, int high)
{
    char *end = NULL;
    long value;

    errno = 0;
    value = strtol(text, &end, 10);
    return ((errno == 0) && (end != text) && (*end == '\0') && (value >= 1) && (value <= (long)high)) ? (int)value : -1;
}

static bool is_interface_name(const char *text)
{
    size_t length = 0u;

    while ((length < (size_t)IF_NAMESIZE) && isgraph((unsigned char)text[length])) {
        length++;
    }
    return (length > 0u) && (length < (size_t)IF_NAMESIZE) && (text[length] == '\0');
}

/* Read the command line. Returns an exit code if there is nothing to run, otherwise -1. */
static int read_options(options_t *options, int count, char *const words[])
{
    int at;

    for (at = 1; at < count; at++) {
        const char *const word = words[at];
        const char *const value = (at + 1 < count) ? words[at + 1] : "";

        if ((strcmp(word, "-h") == 0) || (strcmp(word, "--help") == 0)) {
            print_help();
            return EXIT_SUCCESS;
        } else if (strcmp(word, "--lock-step") == 0) {
            options->lock_step = true;
        } else if (strcmp(word, "--xcp") == 0) {
            options->xcp = true;
        } else if (strcmp(word, "--priority") == 0) {
            options->priority = number_of(value, 99);
            at++;
        } else if (strcmp(word, "--parent") == 0) {
            options->parent = (pid_t)number_of(value, INT_MAX);
            at++;
        } else if ((word[0] == '-') || (options->interface != NULL)) {
            return refuse("usage", "an unknown option, or more than one interface", "see --help");
        } else {
            options->interface = word;
        }
    }
    if ((options->priority < 0) || (options->parent < 0)) {
        return refuse((options->priority < 0) ? "--priority" : "--parent", "needs a number in its range", "see --help");
    }
    if ((options->interface == NULL) || !is_interface_name(options->interface)) {
        return refuse("INTERFACE", "needs 1 to 15 printable characters", "give the name of a CAN interface, say vcan0");
    }
    return -1;
}

int main(int count, char *words[])
{
    const int code = read_options(&ecu.options, count, words);

    return (code >= 0) ? code : run(&ecu);
}
