/*
 * A small XCP slave (ASAM MCD-1 XCP on CAN) for measurement and calibration while the task runs.
 *
 * For a bench, not for a car: there is no seed and key. The slave uses no sockets, clocks or threads: the caller passes packets
 * between two runs of the task. No heap, no recursion; each call has a bounded run time.
 *
 * The calibration is one segment with two pages. ARS_XCP_PAGE_WORKING is writable and active at the start;
 * ARS_XCP_PAGE_REFERENCE holds the values of the build. The controller always reads the same memory, into which a page switch
 * copies the selected page. It never runs with values that is_valid() rejects: a change of the active page is checked at once
 * and reverted if invalid. While the reference page is active, the working page may hold any values; it is checked when it is
 * activated.
 *
 * A master reads calibration and measurements, and writes the calibration, at the addresses in the program file.
 *
 * ars_ecu supports this if it is compiled with the calibration in a section of its own and linked to 32-bit addresses:
 *   -D'ARS_SECTION_CALIBRATION=__attribute__((section("ars_calibration")))' -fno-pie -no-pie
 *
 * This file is the same in every build; ars_ecu_config.h holds what differs.
 */
#ifndef ARS_XCP_H
#define ARS_XCP_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_ecu_config.h"

#ifdef __cplusplus
extern "C" {
#endif

enum {
    ARS_XCP_LENGTH_MAX = (ARS_XCP_COMMAND_MAX > ARS_XCP_MEASUREMENT_MAX) ? ARS_XCP_COMMAND_MAX : ARS_XCP_MEASUREMENT_MAX,
    ARS_XCP_DOWNLOAD_MAX = ARS_XCP_COMMAND_MAX - 2,
    ARS_XCP_UPLOAD_MAX = ARS_XCP_COMMAND_MAX - 1,
    ARS_XCP_DAQ_MAX = 8,     /* lists of measurements */
    ARS_XCP_ODT_MAX = 32,    /* packets of all lists together */
    ARS_XCP_ENTRY_MAX = ARS_XCP_MEASUREMENT_MAX - 1 /* measurements in a packet, and bytes of all of them */
};

enum { ARS_XCP_PAGE_WORKING = 0, ARS_XCP_PAGE_REFERENCE = 1 };

/* Memory of the slave. The caller owns it and keeps it while the slave is used. */
typedef struct {
    uint8_t *calibration;           /* writable memory that the controller reads */
    uint8_t *working;               /* the working page while it is not active; calibration_size bytes */
    uint8_t *reference;             /* the reference page; calibration_size bytes */
    const uint8_t *measurements;
    uint32_t calibration_address;   /* address that a master uses for it */
    uint32_t calibration_size;      /* bytes */
    uint32_t measurements_address;
    uint32_t measurements_size;
    bool (*is_valid)(void);         /* whether the controller may run with the contents of calibration */
} ars_xcp_setup_t;

typedef struct {
    uint8_t data[ARS_XCP_LENGTH_MAX];
    uint8_t length;
} ars_xcp_packet_t;

/* One measurement in a packet. Private. */
typedef struct {
    const uint8_t *from;            /* NULL: not written yet */
    uint8_t size;
} ars_xcp_entry_t;

/* A packet of a list: object descriptor table (ODT). Private. */
typedef struct {
    ars_xcp_entry_t entries[ARS_XCP_ENTRY_MAX];
    uint8_t count;
} ars_xcp_odt_t;

/* A list of measurements. Private. */
typedef struct {
    uint8_t first;                  /* index of its first packet, which is also the packet's identifier; the others follow */
    uint8_t count;
    uint8_t prescaler;
    uint8_t waiting;                /* runs of the task until it is due */
    bool with_timestamp;
    bool has_event;
    bool selected;
    bool running;
} ars_xcp_daq_t;

/* State of one slave. The caller may read the first two fields; the rest is private. */
typedef struct {
    bool connected;
    uint8_t ecu_page;               /* page of the controller */
    uint8_t master_page;            /* page that the master reads and writes */
    ars_xcp_setup_t setup;
    uint8_t space;                  /* address space of the transfer address */
    uint32_t address;               /* transfer address */
    uint32_t clock;                 /* time of the task, in units of the timestamp */
    uint8_t allocation;             /* progress of the allocation of lists */
    uint8_t daq_count;
    uint8_t odt_count;
    uint8_t pointed_odt;            /* packet of the next entry to write */
    uint8_t pointed_entry;
    bool pointer_set;
    ars_xcp_daq_t daqs[ARS_XCP_DAQ_MAX];
    ars_xcp_odt_t odts[ARS_XCP_ODT_MAX];
} ars_xcp_t;

/* Initialise: not connected, working page active. Both pages start with the contents of setup->calibration, which must be valid. */
void ars_xcp_init(ars_xcp_t *self, const ars_xcp_setup_t *setup);

/*
 * Process a packet of the master.
 *
 * in:     length bytes; at most ARS_XCP_COMMAND_MAX are accepted, and bytes that the command does not need are ignored.
 * answer: receives the answer.
 * Returns whether to send the answer: always while connected, otherwise only for CONNECT.
 */
bool ars_xcp_command(ars_xcp_t *self, const uint8_t *in, uint8_t length, ars_xcp_packet_t *answer);

/*
 * Sample all lists that are due and advance the clock of the timestamps. Call it after each run of the task.
 *
 * packets: receives the packets, to be sent in this order.
 * Returns the number of packets.
 */
uint8_t ars_xcp_event(ars_xcp_t *self, ars_xcp_packet_t packets[ARS_XCP_ODT_MAX]);

#ifdef __cplusplus
}
#endif

#endif /* ARS_XCP_H */
