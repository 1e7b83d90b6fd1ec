/*
 * AUTOSAR E2E profile 1, variant 1A, and its state machine. See ars_e2e.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_e2e.h"

#include "ars_sections.h"

#if ARS_E2E_BUILD != 0xC9A75925u
#error "ars_e2e.h and this source come from different builds"
#endif

ARS_SECTION_CONST static const uint8_t counter_max = 14u;
ARS_SECTION_CONST static const uint8_t max_delta_counter_init = 1u;
ARS_SECTION_CONST static const uint8_t max_no_new_or_repeated_data = 3u;
ARS_SECTION_CONST static const uint8_t sync_counter_init = 1u;

ARS_SECTION_CONST static const uint32_t min_ok_state_init = 2u;
ARS_SECTION_CONST static const uint32_t max_error_state_init = 2u;
ARS_SECTION_CONST static const uint32_t min_ok_state_valid = 2u;
ARS_SECTION_CONST static const uint32_t max_error_state_valid = 3u;
ARS_SECTION_CONST static const uint32_t min_ok_state_invalid = 3u;
ARS_SECTION_CONST static const uint32_t max_error_state_invalid = 2u;

/* Previous cycles that remain in the window, in both halves: 5 bits from bit 1. */
ARS_SECTION_CONST static const uint32_t window_mask = 0x003E003Eu;

/* CRC-8 of each byte, polynomial 0x1D. */
ARS_SECTION_CONST static const uint8_t crc_table[256] = {
    0x00u, 0x1Du, 0x3Au, 0x27u, 0x74u, 0x69u, 0x4Eu, 0x53u,
    0xE8u, 0xF5u, 0xD2u, 0xCFu, 0x9Cu, 0x81u, 0xA6u, 0xBBu,
    0xCDu, 0xD0u, 0xF7u, 0xEAu, 0xB9u, 0xA4u, 0x83u, 0x9Eu,
    0x25u, 0x38u, 0x1Fu, 0x02u, 0x51u, 0x4Cu, 0x6Bu, 0x76u,
    0x87u, 0x9Au, 0xBDu, 0xA0u, 0xF3u, 0xEEu, 0xC9u, 0xD4u,
    0x6Fu, 0x72u, 0x55u, 0x48u, 0x1Bu, 0x06u, 0x21u, 0x3Cu,
    0x4Au, 0x57u, 0x70u, 0x6Du, 0x3Eu, 0x23u, 0x04u, 0x19u,
    0xA2u, 0xBFu, 0x98u, 0x85u, 0xD6u, 0xCBu, 0xECu, 0xF1u,
    0x13u, 0x0Eu, 0x29u, 0x34u, 0x67u, 0x7Au, 0x5Du, 0x40u,
    0xFBu, 0xE6u, 0xC1u, 0xDCu, 0x8Fu, 0x92u, 0xB5u, 0xA8u,
    0xDEu, 0xC3u, 0xE4u, 0xF9u, 0xAAu, 0xB7u, 0x90u, 0x8Du,
    0x36u, 0x2Bu, 0x0Cu, 0x11u, 0x42u, 0x5Fu, 0x78u, 0x65u,
    0x94u, 0x89u, 0xAEu, 0xB3u, 0xE0u, 0xFDu, 0xDAu, 0xC7u,
    0x7Cu, 0x61u, 0x46u, 0x5Bu, 0x08u, 0x15u, 0x32u, 0x2Fu,
    0x59u, 0x44u, 0x63u, 0x7Eu, 0x2Du, 0x30u, 0x17u, 0x0Au,
    0xB1u, 0xACu, 0x8Bu, 0x96u, 0xC5u, 0xD8u, 0xFFu, 0xE2u,
    0x26u, 0x3Bu, 0x1Cu, 0x01u, 0x52u, 0x4Fu, 0x68u, 0x75u,
    0xCEu, 0xD3u, 0xF4u, 0xE9u, 0xBAu, 0xA7u, 0x80u, 0x9Du,
    0xEBu, 0xF6u, 0xD1u, 0xCCu, 0x9Fu, 0x82u, 0xA5u, 0xB8u,
    0x03u, 0x1Eu, 0x39u, 0x24u, 0x77u, 0x6Au, 0x4Du, 0x50u,
    0xA1u, 0xBCu, 0x9Bu, 0x86u, 0xD5u, 0xC8u, 0xEFu, 0xF2u,
    0x49u, 0x54u, 0x73u, 0x6Eu, 0x3Du, 0x20u, 0x07u, 0x1Au,
    0x6Cu, 0x71u, 0x56u, 0x4Bu, 0x18u, 0x05u, 0x22u, 0x3Fu,
    0x84u, 0x99u, 0xBEu, 0xA3u, 0xF0u, 0xEDu, 0xCAu, 0xD7u,
    0x35u, 0x28u, 0x0Fu, 0x12u, 0x41u, 0x5Cu, 0x7Bu, 0x66u,
    0xDDu, 0xC0u, 0xE7u, 0xFAu, 0xA9u, 0xB4u, 0x93u, 0x8Eu,
    0xF8u, 0xE5u, 0xC2u, 0xDFu, 0x8Cu, 0x91u, 0xB6u, 0xABu,
    0x10u, 0x0Du, 0x2Au, 0x37u, 0x64u, 0x79u, 0x5Eu, 0x43u,
    0xB2u, 0xAFu, 0x88u, 0x95u, 0xC6u, 0xDBu, 0xFCu, 0xE1u,
    0x5Au, 0x47u, 0x60u, 0x7Du, 0x2Eu, 0x33u, 0x14u, 0x09u,
    0x7Fu, 0x62u, 0x45u, 0x58u, 0x0Bu, 0x16u, 0x31u, 0x2Cu,
    0x97u, 0x8Au, 0xADu, 0xB0u, 0xE3u, 0xFEu, 0xD9u, 0xC4u
};

ARS_SECTION_CODE uint8_t ars_e2e_crc(uint16_t data_id, const uint8_t data[8])
{
    uint32_t crc = crc_table[data_id & 0xFFu];

    crc = crc_table[crc ^ ((uint32_t)data_id >> 8u)];
    /* Unrolled: the instructions of a loop would be two fifths of the run time. */
    crc = crc_table[crc ^ data[1]];
    crc = crc_table[crc ^ data[2]];
    crc = crc_table[crc ^ data[3]];
    crc = crc_table[crc ^ data[4]];
    crc = crc_table[crc ^ data[5]];
    crc = crc_table[crc ^ data[6]];
    crc = crc_table[crc ^ data[7]];
    return (uint8_t)crc;
}

ARS_SECTION_CODE void ars_e2e_protect(uint16_t data_id, uint8_t *counter, uint8_t data[8])
{
    data[1] = (uint8_t)((data[1] & 0xF0u) | (*counter & 0x0Fu));
    data[0] = ars_e2e_crc(data_id, data);
    *counter = (*counter < counter_max) ? (uint8_t)(*counter + 1u) : 0u;
}

ARS_SECTION_CODE void ars_e2e_receiver_init(ars_e2e_receiver_t *self)
{
    self->last_counter = 0u;
    self->max_delta_counter = 0u;
    self->sync_counter = 0u;
    self->no_new_or_repeated_data_counter = 0u;
    self->waits_for_first = true;
}

ARS_SECTION_CODE static uint8_t increased(uint8_t counter)
{
    return (counter < counter_max) ? (uint8_t)(counter + 1u) : counter;
}

/* Handle a counter within its window. After a long silence or a jump it must be synchronised first. */
ARS_SECTION_CODE static ars_e2e_status_t accepted(ars_e2e_receiver_t *self, ars_e2e_status_t status)
{
    ars_e2e_status_t result = status;

    if (self->no_new_or_repeated_data_counter > max_no_new_or_repeated_data) {
        self->sync_counter = sync_counter_init;
        result = ARS_E2E_SYNC;
    } else if (self->sync_counter > 0u) {
        self->sync_counter--;
        result = ARS_E2E_SYNC;
    } else {
        /* synchronised */
    }
    self->no_new_or_repeated_data_counter = 0u;
    return result;
}

ARS_SECTION_CODE static ars_e2e_status_t check_counter(ars_e2e_receiver_t *self, uint8_t counter)
{
    const uint32_t received = counter;
    const uint32_t before = self->last_counter;
    const uint32_t delta = (received >= before) ? (received - before) : ((received + counter_max + 1u) - before);
    ars_e2e_status_t status;

    if (delta == 0u) {
        self->no_new_or_repeated_data_counter = increased(self->no_new_or_repeated_data_counter);
        status = ARS_E2E_REPEATED;
    } else if (delta <= self->max_delta_counter) {
        status = accepted(self, (delta == 1u) ? ARS_E2E_OK : ARS_E2E_OK_SOME_LOST);
        self->max_delta_counter = max_delta_counter_init;
        self->last_counter = counter;
    } else {
        self->no_new_or_repeated_data_counter = 0u;
        self->sync_counter = sync_counter_init;
        self->max_delta_counter = max_delta_counter_init;
        self->last_counter = counter;
        status = ARS_E2E_WRONG_SEQUENCE;
    }
    return status;
}

ARS_SECTION_CODE ars_e2e_status_t ars_e2e_check(ars_e2e_receiver_t *self, uint16_t data_id, const uint8_t data[8])
{
    const uint8_t counter = data[1] & 0x0Fu;
    ars_e2e_status_t status;

    self->max_delta_counter = increased(self->max_delta_counter);
    if ((counter > counter_max) || (ars_e2e_crc(data_id, data) != data[0])) {
        status = ARS_E2E_WRONG_CRC;
    } else if (self->waits_for_first) {
        self->waits_for_first = false;
        self->max_delta_counter = max_delta_counter_init;
        self->last_counter = counter;
        status = ARS_E2E_INITIAL;
    } else {
        status = check_counter(self, counter);
    }
    return status;
}

ARS_SECTION_CODE ars_e2e_status_t ars_e2e_no_new_data(ars_e2e_receiver_t *self)
{
    self->max_delta_counter = increased(self->max_delta_counter);
    self->no_new_or_repeated_data_counter = increased(self->no_new_or_repeated_data_counter);
    return ARS_E2E_NO_NEW_DATA;
}

ARS_SECTION_CODE void ars_e2e_supervision_init(ars_e2e_supervision_t *self)
{
    self->window = 0u;
    self->state = ARS_E2E_STATE_NO_DATA;
}

/* Count the ones in each half of a window, by adding neighbouring groups of bits. Counted anew in each cycle, so that the effect of a
 * flipped bit ends with the window. */
ARS_SECTION_CODE static uint32_t ones_of_halves(uint32_t window)
{
    uint32_t sums = window - ((window >> 1u) & 0x55555555u);

    sums = (sums & 0x33333333u) + ((sums >> 2u) & 0x33333333u);
    return (sums + (sums >> 4u)) & 0x00070007u;
}

ARS_SECTION_CODE ars_e2e_state_t ars_e2e_supervise(ars_e2e_supervision_t *self, bool is_good, bool is_damaged)
{
    const uint32_t found = (is_good ? 1u : 0u) | (is_damaged ? 0x10000u : 0u);

    if (self->state == ARS_E2E_STATE_NO_DATA) {
        /* The first correct frame (INITIAL) is good, but does not count yet. */
        self->state = is_good ? ARS_E2E_STATE_INIT : ARS_E2E_STATE_NO_DATA;
    } else {
        uint32_t min_ok = min_ok_state_invalid;
        uint32_t max_error = max_error_state_invalid;
        uint32_t counts;
        bool stays_init = false;

        if (self->state == ARS_E2E_STATE_VALID) {
            min_ok = min_ok_state_valid;
            max_error = max_error_state_valid;
        } else if (self->state == ARS_E2E_STATE_INIT) {
            min_ok = min_ok_state_init;
            max_error = max_error_state_init;
            stays_init = true;
        } else {
            /* INVALID */
        }
        self->window = ((self->window << 1u) & window_mask) | found;
        counts = ones_of_halves(self->window);
        if ((counts >> 16u) > max_error) {
            self->state = ARS_E2E_STATE_INVALID;
        } else if ((counts & 0x07u) >= min_ok) {
            self->state = ARS_E2E_STATE_VALID;
        } else {
            self->state = stays_init ? ARS_E2E_STATE_INIT : ARS_E2E_STATE_INVALID;
        }
    }
    return self->state;
}
