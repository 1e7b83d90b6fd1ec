/*
 * The XCP slave alone, for tests. It reads records from standard input and writes a result for each to standard output.
 *
 * 'C' length bytes: a packet of the master. Result: answered, length and all bytes of the answer.
 * 'E':              a run of the task; the measurements' first byte counts the runs. Result: a count, and packets as above.
 *
 * Each result ends with the broken invariants, bit by bit (see `broken`). The first line of output is text with the offsets.
 */
#define _POSIX_C_SOURCE 200809L

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include "ars_controller.h"
#include "ars_map.h"
#include "ars_task.h"
#include "ars_xcp.h"

extern uint8_t __start_ars_calibration[];
extern uint8_t __stop_ars_calibration[];

static ars_xcp_t *slave;
static ars_xcp_setup_t setup;
static ars_xcp_packet_t *answer;
static ars_xcp_packet_t *packets;

/* Memory with a copy of its required content. */
typedef struct {
    uint8_t *now;
    uint8_t *before;
    size_t size;
} kept_t;

static kept_t around; /* the pages of memory around the section */
static kept_t reference;
static kept_t measurements;

static bool is_valid(void)
{
    return ars_parameters_valid(&ars_parameters_default);
}

/* Allocate exactly `size` bytes, so that the sanitizer detects an overrun. */
static void *block(size_t size)
{
    void *const result = malloc((size > 0u) ? size : 1u);

    if (result == NULL) {
        exit(3);
    }
    return result;
}

/* Copy byte by byte: the sanitizer's memcpy rejects parts of the pages around the section. */
static kept_t keep(uint8_t *now, size_t size)
{
    const kept_t result = { now, block(size), size };

    for (size_t k = 0u; k < size; k++) {
        result.before[k] = now[k];
    }
    return result;
}

static bool is_same(const uint8_t *now, const kept_t *kept, size_t from, size_t to)
{
    while ((from < to) && (now[from] == kept->before[from])) {
        from++;
    }
    return from >= to;
}

static void set_up(void)
{
    const size_t size = (size_t)(__stop_ars_calibration - __start_ars_calibration);
    const uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE);
    const uintptr_t before = (uintptr_t)__start_ars_calibration % page;
    uint8_t *const first = __start_ars_calibration - before;
    const size_t pages = (size_t)(((before + size + page - 1u) / page) * page);
    uint8_t *const measured = block(sizeof(ars_task_t));

    if (mprotect(first, pages, PROT_READ | PROT_WRITE) != 0) {
        exit(3);
    }
    around = keep(first, pages);
    for (size_t k = 0u; k < sizeof(ars_task_t); k++) {
        measured[k] = (uint8_t)((7u * k) + 3u);
    }
    measurements = keep(measured, sizeof(ars_task_t));
    setup = (ars_xcp_setup_t) { .calibration = __start_ars_calibration, .working = block(size), .reference = block(size),
        .measurements = measured, .calibration_address = 0x10000000, .calibration_size = (uint32_t)size,
        .measurements_address = 0x20000000, .measurements_size = (uint32_t)sizeof(ars_task_t), .is_valid = is_valid };
    slave = block(sizeof *slave);
    answer = block(sizeof *answer);
    packets = block((size_t)ARS_XCP_ODT_MAX * sizeof *packets);
    ars_xcp_init(slave, &setup);
    reference = keep(setup.reference, size);
}

/* Broken invariants: 1 the section's neighbours were written, 2 the reference page, 4 the measurements; 8 the controller would run
 * with invalid parameters; 16 the reference page is active but the controller does not read it. */
static unsigned int broken(void)
{
    const size_t size = setup.calibration_size;
    const size_t before = (size_t)(__start_ars_calibration - around.now);
    const bool is_kept = is_same(around.now, &around, 0u, before) && is_same(around.now, &around, before + size, around.size);
    const bool on_reference = slave->ecu_page == (uint8_t)ARS_XCP_PAGE_REFERENCE;

    return (is_kept ? 0u : 1u) | (is_same(setup.reference, &reference, 0u, size) ? 0u : 2u)
        | (is_same(measurements.now, &measurements, 0u, measurements.size) ? 0u : 4u) | (is_valid() ? 0u : 8u)
        | ((on_reference && !is_same(setup.calibration, &reference, 0u, size)) ? 16u : 0u);
}

static void put_packet(const ars_xcp_packet_t *packet)
{
    (void)putchar(packet->length);
    (void)fwrite(packet->data, 1u, sizeof packet->data, stdout);
}

static void on_command(void)
{
    const int length = getchar();
    uint8_t *const in = block((size_t)length);

    if (fread(in, 1u, (size_t)length, stdin) != (size_t)length) {
        exit(3);
    }
    (void)putchar(ars_xcp_command(slave, in, (uint8_t)length, answer) ? 1 : 0);
    put_packet(answer);
    free(in);
}

static void on_event(void)
{
    uint8_t count;

    measurements.now[0]++;
    measurements.before[0]++;
    count = ars_xcp_event(slave, packets);
    (void)putchar(count);
    for (uint8_t k = 0u; k < count; k++) {
        put_packet(&packets[k]);
    }
}

static size_t offset_of(const void *object)
{
    return (size_t)((const uint8_t *)object - __start_ars_calibration);
}

int main(void)
{
    set_up();
    (void)printf("size=%zu rear_angle_max=%zu enable_speed=%zu speeds=%zu table=%zu measurements=%zu packet=%zu\n",
        (size_t)setup.calibration_size, offset_of(&ars_parameters_default.rear_angle_max),
        offset_of(&ars_parameters_default.enable_speed), offset_of(ars_map_speed_breakpoints),
        offset_of(ars_map_yaw_rate_table), sizeof(ars_task_t), sizeof answer->data);
    (void)fflush(stdout);
    for (int record = getchar(); record != EOF; record = getchar()) {
        if (record == 'C') {
            on_command();
        } else {
            on_event();
        }
        (void)putchar((int)broken());
        (void)fflush(stdout);
    }
    return 0;
}
