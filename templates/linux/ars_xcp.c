/*
 * The XCP slave. See ars_xcp.h.
 *
 * Names of commands, fields and errors are those of ASAM MCD-1 XCP, protocol layer 1. Numbers of more than one byte have the
 * byte order of this machine, which CONNECT reports.
 *
 * This file is the same in every build; ars_ecu_config.h holds what differs.
 */
#include "ars_xcp.h"

#include <stddef.h>
#include <string.h>

/* First byte of an answer. */
enum { POSITIVE = 0xFF, NEGATIVE = 0xFE };

/* Second byte of a negative answer. */
enum {
    ERR_CMD_SYNCH = 0x00,
    ERR_DAQ_ACTIVE = 0x11,
    ERR_CMD_UNKNOWN = 0x20,
    ERR_CMD_SYNTAX = 0x21,
    ERR_OUT_OF_RANGE = 0x22,
    ERR_WRITE_PROTECTED = 0x23,
    ERR_ACCESS_DENIED = 0x24,
    ERR_PAGE_NOT_VALID = 0x26,
    ERR_MODE_NOT_VALID = 0x27,
    ERR_SEGMENT_NOT_VALID = 0x28,
    ERR_SEQUENCE = 0x29,
    ERR_DAQ_CONFIG = 0x2A,
    ERR_MEMORY_OVERFLOW = 0x30,
    DONE = 0xFF /* no error */
};

enum { CMD_CONNECT = 0xFF };

enum { RESOURCE_CAL_PAG = 0x01, RESOURCE_DAQ = 0x04 };
enum { COMM_MODE_MOTOROLA = 0x01, COMM_MODE_OPTIONAL = 0x80 };
enum { STATUS_DAQ_RUNNING = 0x40 };
enum { CHECKSUM_CRC_32 = 0x09 };
enum { PAGE_MODE_ECU = 0x01, PAGE_MODE_XCP = 0x02, PAGE_MODE_ALL = 0x80 };
enum { PAGE_READ = 0x0F, PAGE_WRITE = 0x30 };
enum { PAGES = 2 };
enum { DAQ_DYNAMIC = 0x01, DAQ_PRESCALER = 0x02, DAQ_TIMESTAMP = 0x10 };
enum { MODE_SELECTED = 0x01, MODE_TIMESTAMP = 0x10, MODE_RUNNING = 0x40 };
enum { EVENT_DAQ = 0x04, EVENT_CONSISTENT = 0x80 };
enum { TIMESTAMP_BYTES = 2 };

/* Address space of the transfer address. */
enum { SPACE_NONE, SPACE_MEMORY, SPACE_BUILD, SPACE_A2L, SPACE_EVENT };

/* Progress of the allocation of lists. */
enum { ALLOCATION_NONE, ALLOCATION_FREED, ALLOCATION_DAQ, ALLOCATION_ODT, ALLOCATION_ENTRY };

static const uint8_t build_name[] = ARS_XCP_BUILD_NAME;
static const uint8_t a2l_name[] = ARS_XCP_A2L_NAME;
static const uint8_t event_name[] = ARS_XCP_EVENT_NAME;

/* --- numbers in packets ------------------------------------------------------------------------------------------- */

static uint16_t word_at(const uint8_t *from)
{
    uint16_t value;

    (void)memcpy(&value, from, sizeof value);
    return value;
}

static uint32_t dword_at(const uint8_t *from)
{
    uint32_t value;

    (void)memcpy(&value, from, sizeof value);
    return value;
}

static void put_word(uint8_t *to, uint16_t value)
{
    (void)memcpy(to, &value, sizeof value);
}

static void put_dword(uint8_t *to, uint32_t value)
{
    (void)memcpy(to, &value, sizeof value);
}

static uint8_t byte_order(void)
{
    const uint16_t one = 1u;
    uint8_t first;

    (void)memcpy(&first, &one, sizeof first);
    return (first == 1u) ? (uint8_t)0u : (uint8_t)COMM_MODE_MOTOROLA;
}

/* --- memory ------------------------------------------------------------------------------------------------------- */

static bool is_inside(uint32_t address, uint32_t size, uint32_t base, uint32_t base_size)
{
    return (address >= base) && (size <= base_size) && ((address - base) <= (base_size - size));
}

static bool is_calibration(const ars_xcp_t *self, uint32_t address, uint32_t size)
{
    return is_inside(address, size, self->setup.calibration_address, self->setup.calibration_size);
}

static bool is_measurement(const ars_xcp_t *self, uint32_t address, uint32_t size)
{
    return is_inside(address, size, self->setup.measurements_address, self->setup.measurements_size);
}

/* Present location of a page of the calibration. */
static uint8_t *page_of(const ars_xcp_t *self, uint8_t page)
{
    uint8_t *result = self->setup.reference;

    if (page == (uint8_t)ARS_XCP_PAGE_WORKING) {
        result = (self->ecu_page == page) ? self->setup.calibration : self->setup.working;
    }
    return result;
}

/* Memory that a master reads at an address, or NULL. */
static const uint8_t *readable(const ars_xcp_t *self, uint32_t address, uint32_t size)
{
    const uint8_t *result = NULL;

    if (is_calibration(self, address, size)) {
        result = &page_of(self, self->master_page)[address - self->setup.calibration_address];
    } else if (is_measurement(self, address, size)) {
        result = &self->setup.measurements[address - self->setup.measurements_address];
    } else {
        /* not for a master */
    }
    return result;
}

/* Memory at the transfer address, or NULL. */
static const uint8_t *transferred(const ars_xcp_t *self, uint32_t size)
{
    const uint8_t *result = NULL;

    if (self->space == (uint8_t)SPACE_MEMORY) {
        result = readable(self, self->address, size);
    } else if ((self->space == (uint8_t)SPACE_BUILD) && is_inside(self->address, size, 0u, (uint32_t)sizeof build_name - 1u)) {
        result = &build_name[self->address];
    } else if ((self->space == (uint8_t)SPACE_A2L) && is_inside(self->address, size, 0u, (uint32_t)sizeof a2l_name - 1u)) {
        result = &a2l_name[self->address];
    } else if ((self->space == (uint8_t)SPACE_EVENT) && is_inside(self->address, size, 0u, (uint32_t)sizeof event_name - 1u)) {
        result = &event_name[self->address];
    } else {
        /* not for a master */
    }
    return result;
}

/* --- the session -------------------------------------------------------------------------------------------------- */

static bool is_any_running(const ars_xcp_t *self)
{
    bool running = false;
    uint8_t k;

    for (k = 0u; k < self->daq_count; k++) {
        running = running || self->daqs[k].running;
    }
    return running;
}

static void clear_lists(ars_xcp_t *self)
{
    (void)memset(self->daqs, 0, sizeof self->daqs);
    (void)memset(self->odts, 0, sizeof self->odts);
    self->daq_count = 0u;
    self->odt_count = 0u;
    self->pointer_set = false;
    self->allocation = (uint8_t)ALLOCATION_NONE;
}

static uint8_t on_connect(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    if (in->data[1] != 0u) { /* user-defined modes are not supported */
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    self->connected = true;
    self->space = (uint8_t)SPACE_NONE;
    clear_lists(self);
    answer->data[1] = (uint8_t)RESOURCE_CAL_PAG | (uint8_t)RESOURCE_DAQ;
    answer->data[2] = byte_order() | (uint8_t)COMM_MODE_OPTIONAL;
    answer->data[3] = (uint8_t)ARS_XCP_COMMAND_MAX;
    put_word(&answer->data[4], (uint16_t)ARS_XCP_MEASUREMENT_MAX);
    answer->data[6] = 1u; /* version of the protocol layer */
    answer->data[7] = 1u; /* and of the transport layer */
    answer->length = 8u;
    return (uint8_t)DONE;
}

/* The calibration is not changed. */
static uint8_t on_disconnect(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)in;
    (void)answer;
    self->connected = false;
    clear_lists(self);
    return (uint8_t)DONE;
}

static uint8_t on_get_status(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)in;
    answer->data[1] = is_any_running(self) ? (uint8_t)STATUS_DAQ_RUNNING : 0u;
    answer->length = 6u; /* nothing is protected, no configuration is stored */
    return (uint8_t)DONE;
}

static uint8_t on_synch(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)self;
    (void)in;
    (void)answer;
    return (uint8_t)ERR_CMD_SYNCH;
}

static uint8_t on_get_comm_mode_info(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)self;
    (void)in;
    answer->data[7] = 0x10u; /* driver version 1.0; no block or interleaved mode */
    answer->length = 8u;
    return (uint8_t)DONE;
}

/* The name is uploaded from the transfer address. */
static uint8_t on_get_id(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    enum { TEXT = 0, A2L_NAME = 1 /* without path and extension */ };

    if (in->data[1] == (uint8_t)TEXT) {
        self->space = (uint8_t)SPACE_BUILD;
        self->address = 0u;
        put_dword(&answer->data[4], (uint32_t)sizeof build_name - 1u);
    } else if (in->data[1] == (uint8_t)A2L_NAME) {
        self->space = (uint8_t)SPACE_A2L;
        self->address = 0u;
        put_dword(&answer->data[4], (uint32_t)sizeof a2l_name - 1u);
    } else {
        put_dword(&answer->data[4], 0u); /* there is no other identification */
    }
    answer->length = 8u;
    return (uint8_t)DONE;
}

/* --- reading and writing ------------------------------------------------------------------------------------------ */

static uint8_t set_address(ars_xcp_t *self, uint8_t extension, const uint8_t *address)
{
    uint8_t result = (uint8_t)ERR_OUT_OF_RANGE;

    if (extension == 0u) {
        self->space = (uint8_t)SPACE_MEMORY;
        self->address = dword_at(address);
        result = (uint8_t)DONE;
    }
    return result;
}

static uint8_t on_set_mta(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)answer;
    return set_address(self, in->data[3], &in->data[4]);
}

/* Upload from the transfer address and advance it. */
static uint8_t upload(ars_xcp_t *self, uint8_t size, ars_xcp_packet_t *answer)
{
    const uint8_t *const from = transferred(self, size);

    if ((size == 0u) || (size > (uint8_t)ARS_XCP_UPLOAD_MAX)) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if (self->space == (uint8_t)SPACE_NONE) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (from == NULL) {
        return (uint8_t)ERR_ACCESS_DENIED;
    }
    (void)memcpy(&answer->data[1], from, size);
    answer->length = (uint8_t)(size + 1u);
    self->address += size;
    return (uint8_t)DONE;
}

static uint8_t on_upload(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    return upload(self, in->data[1], answer);
}

static uint8_t on_short_upload(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const uint8_t result = set_address(self, in->data[3], &in->data[4]);

    return (result == (uint8_t)DONE) ? upload(self, in->data[1], answer) : result;
}

/* CRC-32 of IEEE 802.3, four bits at a time. The whole calibration takes well under a millisecond. */
static uint32_t crc_of(const uint8_t *from, uint32_t size)
{
    static const uint32_t of_four_bits[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu
    };
    uint32_t crc = 0xFFFFFFFFu;
    uint32_t k;

    for (k = 0u; k < size; k++) {
        crc ^= from[k];
        crc = (crc >> 4u) ^ of_four_bits[crc & 0x0Fu];
        crc = (crc >> 4u) ^ of_four_bits[crc & 0x0Fu];
    }
    return ~crc;
}

static uint8_t on_build_checksum(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const uint32_t size = dword_at(&in->data[4]);
    const uint8_t *const from = transferred(self, size);

    if (size == 0u) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if (self->space == (uint8_t)SPACE_NONE) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (from == NULL) {
        return (uint8_t)ERR_ACCESS_DENIED;
    }
    answer->data[1] = (uint8_t)CHECKSUM_CRC_32;
    put_dword(&answer->data[4], crc_of(from, size));
    answer->length = 8u;
    self->address += size;
    return (uint8_t)DONE;
}

/* Write to the working page. If it is active, an invalid result is reverted. */
static uint8_t write_working(ars_xcp_t *self, uint32_t offset, const uint8_t *from, uint8_t size)
{
    uint8_t *const to = &page_of(self, (uint8_t)ARS_XCP_PAGE_WORKING)[offset];
    uint8_t before[ARS_XCP_DOWNLOAD_MAX];
    uint8_t result = (uint8_t)DONE;

    (void)memcpy(before, to, size);
    (void)memcpy(to, from, size);
    if ((self->ecu_page == (uint8_t)ARS_XCP_PAGE_WORKING) && !self->setup.is_valid()) {
        (void)memcpy(to, before, size);
        result = (uint8_t)ERR_OUT_OF_RANGE;
    }
    return result;
}

/* Write at the transfer address; advance it after success. */
static uint8_t on_download(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const uint8_t size = in->data[1];
    uint8_t result = (uint8_t)ERR_ACCESS_DENIED;

    (void)answer;
    if ((size == 0u) || (size > (uint8_t)ARS_XCP_DOWNLOAD_MAX)) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if ((uint32_t)in->length < (2u + (uint32_t)size)) {
        return (uint8_t)ERR_CMD_SYNTAX;
    }
    if (self->space == (uint8_t)SPACE_NONE) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (transferred(self, size) != NULL) {
        result = (uint8_t)ERR_WRITE_PROTECTED;
        if ((self->space == (uint8_t)SPACE_MEMORY) && is_calibration(self, self->address, size)
            && (self->master_page == (uint8_t)ARS_XCP_PAGE_WORKING)) {
            result = write_working(self, self->address - self->setup.calibration_address, &in->data[2], size);
        }
    }
    if (result == (uint8_t)DONE) {
        self->address += size;
    }
    return result;
}

/* --- pages of the calibration ------------------------------------------------------------------------------------- */

/* Activate a page for the controller. If it is invalid, the old page stays active. */
static uint8_t set_ecu_page(ars_xcp_t *self, uint8_t page)
{
    const ars_xcp_setup_t *const setup = &self->setup;
    uint8_t result = (uint8_t)DONE;

    if (page == self->ecu_page) {
        /* as it is */
    } else if (page == (uint8_t)ARS_XCP_PAGE_REFERENCE) {
        (void)memcpy(setup->working, setup->calibration, setup->calibration_size);
        (void)memcpy(setup->calibration, setup->reference, setup->calibration_size);
        self->ecu_page = page;
    } else {
        (void)memcpy(setup->calibration, setup->working, setup->calibration_size);
        if (setup->is_valid()) {
            self->ecu_page = page;
        } else {
            (void)memcpy(setup->calibration, setup->reference, setup->calibration_size);
            result = (uint8_t)ERR_PAGE_NOT_VALID;
        }
    }
    return result;
}

static uint8_t on_set_cal_page(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const uint8_t mode = in->data[1];
    const uint8_t who = mode & ((uint8_t)PAGE_MODE_ECU | (uint8_t)PAGE_MODE_XCP);
    uint8_t result = (uint8_t)DONE;

    (void)answer;
    if ((who == 0u) || ((mode & (uint8_t)~(uint8_t)PAGE_MODE_ALL) != who)) {
        return (uint8_t)ERR_MODE_NOT_VALID;
    }
    if ((in->data[2] != 0u) && ((mode & (uint8_t)PAGE_MODE_ALL) == 0u)) {
        return (uint8_t)ERR_SEGMENT_NOT_VALID;
    }
    if (in->data[3] >= (uint8_t)PAGES) {
        return (uint8_t)ERR_PAGE_NOT_VALID;
    }
    if ((who & (uint8_t)PAGE_MODE_ECU) != 0u) {
        result = set_ecu_page(self, in->data[3]);
    }
    if ((result == (uint8_t)DONE) && ((who & (uint8_t)PAGE_MODE_XCP) != 0u)) {
        self->master_page = in->data[3];
    }
    return result;
}

static uint8_t on_get_cal_page(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    if ((in->data[1] != (uint8_t)PAGE_MODE_ECU) && (in->data[1] != (uint8_t)PAGE_MODE_XCP)) {
        return (uint8_t)ERR_MODE_NOT_VALID;
    }
    if (in->data[2] != 0u) {
        return (uint8_t)ERR_SEGMENT_NOT_VALID;
    }
    answer->data[3] = (in->data[1] == (uint8_t)PAGE_MODE_ECU) ? self->ecu_page : self->master_page;
    answer->length = 4u;
    return (uint8_t)DONE;
}

static uint8_t on_get_pag_processor_info(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)self;
    (void)in;
    answer->data[1] = 1u; /* one segment, which cannot be frozen */
    answer->length = 3u;
    return (uint8_t)DONE;
}

static uint8_t on_get_segment_info(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const uint8_t mode = in->data[1];

    if (in->data[2] != 0u) {
        return (uint8_t)ERR_SEGMENT_NOT_VALID;
    }
    if ((mode == 0u) && (in->data[3] <= 1u)) { /* address or size */
        put_dword(&answer->data[4], (in->data[3] == 0u) ? self->setup.calibration_address : self->setup.calibration_size);
        answer->length = 8u;
    } else if (mode == 1u) { /* properties; no address extension, mapping, compression or encryption */
        answer->data[1] = (uint8_t)PAGES;
        answer->length = 6u;
    } else { /* address mapping is not supported */
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    return (uint8_t)DONE;
}

static uint8_t on_get_page_info(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)self;
    if (in->data[2] != 0u) {
        return (uint8_t)ERR_SEGMENT_NOT_VALID;
    }
    if (in->data[3] >= (uint8_t)PAGES) {
        return (uint8_t)ERR_PAGE_NOT_VALID;
    }
    answer->data[1] = (uint8_t)PAGE_READ;
    if (in->data[3] == (uint8_t)ARS_XCP_PAGE_WORKING) {
        answer->data[1] |= (uint8_t)PAGE_WRITE;
    }
    answer->length = 3u;
    return (uint8_t)DONE;
}

/* Copy the reference page to the working page. */
static uint8_t on_copy_cal_page(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    uint8_t *const to = page_of(self, (uint8_t)ARS_XCP_PAGE_WORKING);

    (void)answer;
    if ((in->data[1] != 0u) || (in->data[3] != 0u)) {
        return (uint8_t)ERR_SEGMENT_NOT_VALID;
    }
    if ((in->data[2] >= (uint8_t)PAGES) || (in->data[4] >= (uint8_t)PAGES)) {
        return (uint8_t)ERR_PAGE_NOT_VALID;
    }
    if (in->data[4] != (uint8_t)ARS_XCP_PAGE_WORKING) {
        return (uint8_t)ERR_WRITE_PROTECTED;
    }
    if (in->data[2] != (uint8_t)ARS_XCP_PAGE_WORKING) {
        (void)memcpy(to, self->setup.reference, self->setup.calibration_size);
    }
    return (uint8_t)DONE;
}

/* --- lists of measurements ---------------------------------------------------------------------------------------- */

/* List with the number at this place of a command, or NULL. */
static ars_xcp_daq_t *daq_at(ars_xcp_t *self, const uint8_t *number)
{
    const uint16_t index = word_at(number);

    return (index < self->daq_count) ? &self->daqs[index] : NULL;
}

static uint8_t on_free_daq(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)in;
    (void)answer;
    clear_lists(self);
    self->allocation = (uint8_t)ALLOCATION_FREED;
    return (uint8_t)DONE;
}

static uint8_t on_alloc_daq(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const uint16_t count = word_at(&in->data[2]);

    (void)answer;
    if ((self->allocation != (uint8_t)ALLOCATION_FREED) && (self->allocation != (uint8_t)ALLOCATION_DAQ)) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (count == 0u) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if (count > (uint16_t)ARS_XCP_DAQ_MAX) {
        return (uint8_t)ERR_MEMORY_OVERFLOW;
    }
    self->daq_count = (uint8_t)count;
    self->allocation = (uint8_t)ALLOCATION_DAQ;
    return (uint8_t)DONE;
}

/* Allocate the packets of a list; once for each list. */
static uint8_t on_alloc_odt(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    ars_xcp_daq_t *const daq = daq_at(self, &in->data[2]);
    const uint8_t count = in->data[4];

    (void)answer;
    if ((self->allocation != (uint8_t)ALLOCATION_DAQ) && (self->allocation != (uint8_t)ALLOCATION_ODT)) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if ((daq == NULL) || (count == 0u)) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if (daq->count != 0u) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (((uint32_t)self->odt_count + (uint32_t)count) > (uint32_t)ARS_XCP_ODT_MAX) {
        return (uint8_t)ERR_MEMORY_OVERFLOW;
    }
    daq->first = self->odt_count;
    daq->count = count;
    self->odt_count = (uint8_t)(self->odt_count + count);
    self->allocation = (uint8_t)ALLOCATION_ODT;
    return (uint8_t)DONE;
}

/* Allocate the entries of a packet; once for each packet. Zero entries: the packet contains the timestamp alone. */
static uint8_t on_alloc_odt_entry(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const ars_xcp_daq_t *const daq = daq_at(self, &in->data[2]);
    const uint8_t count = in->data[5];
    ars_xcp_odt_t *odt;

    (void)answer;
    if ((self->allocation != (uint8_t)ALLOCATION_ODT) && (self->allocation != (uint8_t)ALLOCATION_ENTRY)) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (is_any_running(self)) {
        return (uint8_t)ERR_DAQ_ACTIVE;
    }
    if ((daq == NULL) || (in->data[4] >= daq->count)) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    odt = &self->odts[daq->first + in->data[4]];
    if (odt->count != 0u) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (count > (uint8_t)ARS_XCP_ENTRY_MAX) {
        return (uint8_t)ERR_MEMORY_OVERFLOW;
    }
    odt->count = count;
    self->allocation = (uint8_t)ALLOCATION_ENTRY;
    return (uint8_t)DONE;
}

static uint8_t on_set_daq_ptr(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const ars_xcp_daq_t *const daq = daq_at(self, &in->data[2]);

    (void)answer;
    if ((daq == NULL) || (in->data[4] >= daq->count) || (in->data[5] >= self->odts[daq->first + in->data[4]].count)) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if (daq->running) {
        return (uint8_t)ERR_DAQ_ACTIVE;
    }
    self->pointed_odt = (uint8_t)(daq->first + in->data[4]);
    self->pointed_entry = in->data[5];
    self->pointer_set = true;
    return (uint8_t)DONE;
}

/* Size of the entries of a packet, in bytes. */
static uint32_t size_of(const ars_xcp_odt_t *odt)
{
    uint32_t size = 0u;
    uint8_t k;

    for (k = 0u; k < odt->count; k++) {
        size += odt->entries[k].size;
    }
    return size;
}

/* Memory of a measurement: that of the controller, whichever page the master reads. */
static const uint8_t *measurable(const ars_xcp_t *self, uint32_t address, uint8_t size)
{
    const uint8_t *result = readable(self, address, size);

    if (is_calibration(self, address, size)) {
        result = &self->setup.calibration[address - self->setup.calibration_address];
    }
    return result;
}

static bool is_running_odt(const ars_xcp_t *self, uint8_t odt)
{
    bool running = false;
    uint8_t k;

    for (k = 0u; k < self->daq_count; k++) {
        const ars_xcp_daq_t *const daq = &self->daqs[k];

        running = running || (daq->running && (odt >= daq->first) && (odt < (uint8_t)(daq->first + daq->count)));
    }
    return running;
}

/* Write an entry and advance the pointer to the next entry of the packet; after the last one it is unset. */
static uint8_t on_write_daq(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const uint8_t size = in->data[2];
    const uint8_t *const from = measurable(self, dword_at(&in->data[4]), size);
    ars_xcp_odt_t *odt;
    ars_xcp_entry_t *entry;

    (void)answer;
    if (!self->pointer_set) {
        return (uint8_t)ERR_SEQUENCE;
    }
    if (is_running_odt(self, self->pointed_odt)) {
        return (uint8_t)ERR_DAQ_ACTIVE;
    }
    if ((in->data[1] != 0xFFu) || (size == 0u) || (in->data[3] != 0u)) { /* no single bits, no address extension */
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    odt = &self->odts[self->pointed_odt];
    entry = &odt->entries[self->pointed_entry];
    if (((size_of(odt) - entry->size) + size) > (uint32_t)ARS_XCP_ENTRY_MAX) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if (from == NULL) {
        return (uint8_t)ERR_ACCESS_DENIED;
    }
    entry->from = from;
    entry->size = size;
    self->pointed_entry++;
    self->pointer_set = self->pointed_entry < odt->count;
    return (uint8_t)DONE;
}

static uint8_t on_set_daq_list_mode(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    ars_xcp_daq_t *const daq = daq_at(self, &in->data[2]);

    (void)answer;
    if ((in->data[1] & (uint8_t)~(uint8_t)MODE_TIMESTAMP) != 0u) { /* no stimulation, no packets without identifier */
        return (uint8_t)ERR_MODE_NOT_VALID;
    }
    /* There is one event, and no priority. */
    if ((daq == NULL) || (word_at(&in->data[4]) != 0u) || (in->data[6] == 0u) || (in->data[7] != 0u)) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if (daq->running) {
        return (uint8_t)ERR_DAQ_ACTIVE;
    }
    daq->with_timestamp = in->data[1] != 0u;
    daq->prescaler = in->data[6];
    daq->has_event = true;
    return (uint8_t)DONE;
}

static uint8_t on_get_daq_list_mode(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    const ars_xcp_daq_t *const daq = daq_at(self, &in->data[2]);

    if (daq == NULL) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    answer->data[1] = (uint8_t)((daq->selected ? (uint32_t)MODE_SELECTED : 0u)
        | (daq->with_timestamp ? (uint32_t)MODE_TIMESTAMP : 0u) | (daq->running ? (uint32_t)MODE_RUNNING : 0u));
    answer->data[6] = daq->prescaler;
    answer->length = 8u; /* event 0, priority 0 */
    return (uint8_t)DONE;
}

/* Return whether a list has packets, all their entries are written, and the timestamp fits. */
static bool is_complete(const ars_xcp_t *self, const ars_xcp_daq_t *daq)
{
    bool complete = daq->has_event;
    uint32_t entries = 0u;
    uint8_t k;
    uint8_t n;

    for (k = daq->first; k < (uint8_t)(daq->first + daq->count); k++) {
        const ars_xcp_odt_t *const odt = &self->odts[k];
        const uint32_t stamp = (daq->with_timestamp && (k == daq->first)) ? (uint32_t)TIMESTAMP_BYTES : 0u;

        entries += odt->count;
        complete = complete && ((size_of(odt) + stamp) <= (uint32_t)ARS_XCP_ENTRY_MAX);
        for (n = 0u; n < odt->count; n++) {
            complete = complete && (odt->entries[n].from != NULL);
        }
    }
    return complete && (entries > 0u);
}

static void start_list(ars_xcp_daq_t *daq)
{
    if (!daq->running) {
        daq->running = true;
        daq->waiting = 0u;
    }
}

static uint8_t on_start_stop_daq_list(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    enum { STOP = 0, START = 1, SELECT = 2 };
    ars_xcp_daq_t *const daq = daq_at(self, &in->data[2]);

    if (in->data[1] > (uint8_t)SELECT) {
        return (uint8_t)ERR_MODE_NOT_VALID;
    }
    if (daq == NULL) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    if ((in->data[1] != (uint8_t)STOP) && !is_complete(self, daq)) {
        return (uint8_t)ERR_DAQ_CONFIG;
    }
    if (in->data[1] == (uint8_t)START) {
        start_list(daq);
    } else if (in->data[1] == (uint8_t)SELECT) {
        daq->selected = true;
    } else {
        daq->running = false;
    }
    answer->data[1] = daq->first;
    answer->length = 2u;
    return (uint8_t)DONE;
}

/* Check again before the start, because a selected list may have been changed since. All lists start, or none. */
static bool are_selected_complete(const ars_xcp_t *self)
{
    bool complete = true;
    uint8_t k;

    for (k = 0u; k < self->daq_count; k++) {
        complete = complete && (!self->daqs[k].selected || is_complete(self, &self->daqs[k]));
    }
    return complete;
}

static uint8_t on_start_stop_synch(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    enum { STOP_ALL = 0, START_SELECTED = 1, STOP_SELECTED = 2 };
    uint8_t k;

    (void)answer;
    if (in->data[1] > (uint8_t)STOP_SELECTED) {
        return (uint8_t)ERR_MODE_NOT_VALID;
    }
    if ((in->data[1] == (uint8_t)START_SELECTED) && !are_selected_complete(self)) {
        return (uint8_t)ERR_DAQ_CONFIG;
    }
    for (k = 0u; k < self->daq_count; k++) {
        ars_xcp_daq_t *const daq = &self->daqs[k];

        if (in->data[1] == (uint8_t)STOP_ALL) {
            daq->running = false;
        } else if (!daq->selected) {
            /* as it is */
        } else if (in->data[1] == (uint8_t)START_SELECTED) {
            start_list(daq);
        } else {
            daq->running = false;
        }
        daq->selected = false;
    }
    return (uint8_t)DONE;
}

static uint8_t on_get_daq_processor_info(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)in;
    answer->data[1] = (uint8_t)DAQ_DYNAMIC | (uint8_t)DAQ_PRESCALER | (uint8_t)DAQ_TIMESTAMP;
    put_word(&answer->data[2], self->daq_count);
    put_word(&answer->data[4], 1u); /* event */
    answer->length = 8u; /* no predefined list; packets have absolute identifiers */
    return (uint8_t)DONE;
}

static uint8_t on_get_daq_resolution_info(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)self;
    (void)in;
    answer->data[1] = 1u; /* granularity of an entry's size */
    answer->data[2] = (uint8_t)ARS_XCP_ENTRY_MAX;
    answer->data[3] = 1u; /* granularity for stimulation, which is not supported */
    answer->data[5] = ARS_XCP_TIMESTAMP_MODE;
    put_word(&answer->data[6], 1u); /* tick in each unit */
    answer->length = 8u;
    return (uint8_t)DONE;
}

/* Its name is uploaded from the transfer address. */
static uint8_t on_get_daq_event_info(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    if (word_at(&in->data[2]) != 0u) {
        return (uint8_t)ERR_OUT_OF_RANGE;
    }
    self->space = (uint8_t)SPACE_EVENT;
    self->address = 0u;
    answer->data[1] = (uint8_t)EVENT_DAQ | (uint8_t)EVENT_CONSISTENT;
    answer->data[2] = (uint8_t)ARS_XCP_DAQ_MAX;
    answer->data[3] = (uint8_t)(sizeof event_name - 1u);
    answer->data[4] = ARS_XCP_EVENT_CYCLE;
    answer->data[5] = ARS_XCP_EVENT_UNIT;
    answer->length = 7u; /* priority 0 */
    return (uint8_t)DONE;
}

static uint8_t on_get_daq_clock(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    (void)in;
    put_dword(&answer->data[4], self->clock);
    answer->length = 8u;
    return (uint8_t)DONE;
}

/* Sample the packets of a list. Returns their number. */
static uint8_t sample(const ars_xcp_t *self, const ars_xcp_daq_t *daq, ars_xcp_packet_t *packets)
{
    uint8_t k;
    uint8_t n;

    for (k = 0u; k < daq->count; k++) {
        const ars_xcp_odt_t *const odt = &self->odts[daq->first + k];
        ars_xcp_packet_t *const packet = &packets[k];

        packet->data[0] = (uint8_t)(daq->first + k);
        packet->length = 1u;
        if (daq->with_timestamp && (k == 0u)) {
            put_word(&packet->data[1], (uint16_t)(self->clock & 0xFFFFu));
            packet->length = 1u + (uint8_t)TIMESTAMP_BYTES;
        }
        for (n = 0u; n < odt->count; n++) {
            (void)memcpy(&packet->data[packet->length], odt->entries[n].from, odt->entries[n].size);
            packet->length = (uint8_t)(packet->length + odt->entries[n].size);
        }
    }
    return daq->count;
}

uint8_t ars_xcp_event(ars_xcp_t *self, ars_xcp_packet_t packets[ARS_XCP_ODT_MAX])
{
    uint8_t count = 0u;
    uint8_t k;

    self->clock += ARS_XCP_TICKS_PER_RUN;
    for (k = 0u; k < self->daq_count; k++) {
        ars_xcp_daq_t *const daq = &self->daqs[k];

        if (daq->running && (daq->waiting == 0u)) {
            count = (uint8_t)(count + sample(self, daq, &packets[count]));
            daq->waiting = daq->prescaler;
        }
        if (daq->running) {
            daq->waiting--;
        }
    }
    return count;
}

/* --- the commands ------------------------------------------------------------------------------------------------- */

typedef struct {
    uint8_t code;
    uint8_t length; /* smallest number of bytes */
    /* in: command, padded with zeros. answer: positive answer without data, padded with zeros. Returns an error or DONE. */
    uint8_t (*run)(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer);
} command_t;

static const command_t commands[] = {
    { (uint8_t)CMD_CONNECT, 2u, on_connect },
    { 0xFEu, 1u, on_disconnect },
    { 0xFDu, 1u, on_get_status },
    { 0xFCu, 1u, on_synch },
    { 0xFBu, 1u, on_get_comm_mode_info },
    { 0xFAu, 2u, on_get_id },
    { 0xF6u, 8u, on_set_mta },
    { 0xF5u, 2u, on_upload },
    { 0xF4u, 8u, on_short_upload },
    { 0xF3u, 8u, on_build_checksum },
    { 0xF0u, 2u, on_download },
    { 0xEBu, 4u, on_set_cal_page },
    { 0xEAu, 3u, on_get_cal_page },
    { 0xE9u, 1u, on_get_pag_processor_info },
    { 0xE8u, 5u, on_get_segment_info },
    { 0xE7u, 4u, on_get_page_info },
    { 0xE4u, 5u, on_copy_cal_page },
    { 0xE2u, 6u, on_set_daq_ptr },
    { 0xE1u, 8u, on_write_daq },
    { 0xE0u, 8u, on_set_daq_list_mode },
    { 0xDFu, 4u, on_get_daq_list_mode },
    { 0xDEu, 4u, on_start_stop_daq_list },
    { 0xDDu, 2u, on_start_stop_synch },
    { 0xDCu, 1u, on_get_daq_clock },
    { 0xDAu, 1u, on_get_daq_processor_info },
    { 0xD9u, 1u, on_get_daq_resolution_info },
    { 0xD7u, 4u, on_get_daq_event_info },
    { 0xD6u, 1u, on_free_daq },
    { 0xD5u, 4u, on_alloc_daq },
    { 0xD4u, 5u, on_alloc_odt },
    { 0xD3u, 6u, on_alloc_odt_entry }
};

static uint8_t run(ars_xcp_t *self, const ars_xcp_packet_t *in, ars_xcp_packet_t *answer)
{
    uint8_t result = (uint8_t)ERR_CMD_UNKNOWN;
    size_t k;

    for (k = 0u; k < (sizeof commands / sizeof commands[0]); k++) {
        if (commands[k].code == in->data[0]) {
            result = (in->length >= commands[k].length) ? commands[k].run(self, in, answer) : (uint8_t)ERR_CMD_SYNTAX;
        }
    }
    return result;
}

bool ars_xcp_command(ars_xcp_t *self, const uint8_t *in, uint8_t length, ars_xcp_packet_t *answer)
{
    const bool was_connected = self->connected;
    uint8_t result = (uint8_t)ERR_CMD_SYNTAX;
    ars_xcp_packet_t packet;

    (void)memset(&packet, 0, sizeof packet);
    (void)memset(answer, 0, sizeof *answer);
    answer->data[0] = (uint8_t)POSITIVE;
    answer->length = 1u;
    if ((length > 0u) && (length <= (uint8_t)ARS_XCP_COMMAND_MAX)) {
        (void)memcpy(packet.data, in, length);
        packet.length = length;
        if (was_connected || (packet.data[0] == (uint8_t)CMD_CONNECT)) {
            result = run(self, &packet, answer);
        }
    }
    if (result != (uint8_t)DONE) {
        (void)memset(answer, 0, sizeof *answer);
        answer->data[0] = (uint8_t)NEGATIVE;
        answer->data[1] = result;
        answer->length = 2u;
    }
    return was_connected || self->connected;
}

void ars_xcp_init(ars_xcp_t *self, const ars_xcp_setup_t *setup)
{
    (void)memset(self, 0, sizeof *self);
    self->setup = *setup;
    self->ecu_page = (uint8_t)ARS_XCP_PAGE_WORKING;
    self->master_page = (uint8_t)ARS_XCP_PAGE_WORKING;
    (void)memcpy(setup->reference, setup->calibration, setup->calibration_size);
    (void)memcpy(setup->working, setup->calibration, setup->calibration_size);
}
