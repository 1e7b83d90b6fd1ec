/*
 * A small XCP slave (ASAM MCD-1 XCP, packets of CAN): measuring and calibrating while the task runs.
 *
 * For a bench, not for a car: there is no seed and key. Nothing here knows of sockets, clocks or threads: the caller hands
 * packets over, between two runs of the task. No heap, no recursion; each call takes a bounded time.
 *
 * The calibration is one segment with two pages. ARS_XCP_PAGE_WORKING may be written and is active at the start;
 * ARS_XCP_PAGE_REFERENCE is what the build was made with. The controller always reads the same memory, which a switch of its
 * page fills. It never runs with what is_valid() refuses: a change of the page in use is judged at once and taken back; the
 * working page may be edited freely while the reference page is in use, and is judged when it is to be used.
 *
 * A master reads these data and the measurements, and writes the data, at the addresses that it finds in the program's file.
 *
 * ars_ecu can do this where it was compiled with the calibration in a section, and linked to addresses of 32 bits:
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
    ARS_XCP_LENGTH_MAX = 8,  /* bytes of a packet */
    ARS_XCP_DOWNLOAD_MAX = ARS_XCP_LENGTH_MAX - 2,
    ARS_XCP_UPLOAD_MAX = ARS_XCP_LENGTH_MAX - 1,
    ARS_XCP_DAQ_MAX = 8,     /* lists of measurements */
    ARS_XCP_ODT_MAX = 32,    /* their packets in all */
    ARS_XCP_ENTRY_MAX = 7    /* measurements in a packet, and bytes */
};

enum { ARS_XCP_PAGE_WORKING = 0, ARS_XCP_PAGE_REFERENCE = 1 };

/* What the slave works on. All memory is the caller's and stays. */
typedef struct {
    uint8_t *calibration;           /* what the controller reads; may be written */
    uint8_t *working;               /* the working page while it is not in use; calibration_size bytes */
    uint8_t *reference;             /* the reference page; calibration_size bytes */
    const uint8_t *measurements;
    uint32_t calibration_address;   /* by which a master knows it */
    uint32_t calibration_size;      /* bytes */
    uint32_t measurements_address;
    uint32_t measurements_size;
    bool (*is_valid)(void);         /* whether the controller may run with what stands in calibration */
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

/* A packet of a list: object descriptor table. Private. */
typedef struct {
    ars_xcp_entry_t entries[ARS_XCP_ENTRY_MAX];
    uint8_t count;
} ars_xcp_odt_t;

/* A list of measurements. Private. */
typedef struct {
    uint8_t first;                  /* of its packets, which follow each other; also the first packet's identifier */
    uint8_t count;
    uint8_t prescaler;
    uint8_t waiting;                /* runs of the task until it is due */
    bool with_timestamp;
    bool has_event;
    bool selected;
    bool running;
} ars_xcp_daq_t;

/* One slave. The first two are for the caller to read; the rest is private. */
typedef struct {
    bool connected;
    uint8_t ecu_page;               /* which the controller runs on */
    uint8_t master_page;            /* which the master reads and writes */
    ars_xcp_setup_t setup;
    uint8_t space;                  /* what the transfer address points into */
    uint32_t address;               /* transfer address */
    uint32_t clock;                 /* of the task, in units of the timestamp */
    uint8_t allocation;             /* how far the lists are allocated */
    uint8_t daq_count;
    uint8_t odt_count;
    uint8_t pointed_odt;            /* where the next entry is written */
    uint8_t pointed_entry;
    bool pointer_set;
    ars_xcp_daq_t daqs[ARS_XCP_DAQ_MAX];
    ars_xcp_odt_t odts[ARS_XCP_ODT_MAX];
} ars_xcp_t;

/* Not connected, on the working page. What stands in setup->calibration becomes both pages; is_valid() must say so of it. */
void ars_xcp_init(ars_xcp_t *self, const ars_xcp_setup_t *setup);

/*
 * A packet came from the master.
 *
 * in:     length bytes; at most ARS_XCP_LENGTH_MAX are read, and what a command does not need is ignored.
 * answer: written.
 * Returns whether there is an answer to send: to each packet while connected, else to a CONNECT alone.
 */
bool ars_xcp_command(ars_xcp_t *self, const uint8_t *in, uint8_t length, ars_xcp_packet_t *answer);

/*
 * The task has run: the clock of the timestamps advances, and the lists that are due are sampled, all of them at once.
 *
 * packets: to be sent in this order.
 * Returns how many there are.
 */
uint8_t ars_xcp_event(ars_xcp_t *self, ars_xcp_packet_t packets[ARS_XCP_ODT_MAX]);

#ifdef __cplusplus
}
#endif

#endif /* ARS_XCP_H */
