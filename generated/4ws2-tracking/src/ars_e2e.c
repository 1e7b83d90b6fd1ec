/*
 * AUTOSAR E2E profile 1, variant 1A. See ars_e2e.h.
 *
 *
 *
 * Map 4ws2-tracking: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_e2e.h"

#include "ars_sections.h"

#if ARS_E2E_BUILD != 0xA7652821u
#error "ars_e2e.h and this source come from different builds"
#endif

ARS_SECTION_CONST static const uint8_t counter_max = 14u;
ARS_SECTION_CONST static const uint8_t max_delta_counter_init = 1u;
ARS_SECTION_CONST static const uint8_t max_no_new_or_repeated_data = 3u;
ARS_SECTION_CONST static const uint8_t sync_counter_init = 1u;

/* Polynomial 0x1D, four bits at a time. */
ARS_SECTION_CODE static uint8_t crc_of_byte(uint8_t start, uint8_t byte)
{
    ARS_SECTION_CONST static const uint8_t table[16] = {
        0x00u, 0x1Du, 0x3Au, 0x27u, 0x74u, 0x69u, 0x4Eu, 0x53u, 0xE8u, 0xF5u, 0xD2u, 0xCFu, 0x9Cu, 0x81u, 0xA6u, 0xBBu
    };
    uint8_t crc = start ^ byte;

    crc = (uint8_t)((uint32_t)crc << 4u) ^ table[crc >> 4u];
    crc = (uint8_t)((uint32_t)crc << 4u) ^ table[crc >> 4u];
    return crc;
}

ARS_SECTION_CODE uint8_t ars_e2e_crc(uint16_t data_id, const uint8_t data[8])
{
    uint8_t crc = 0u;
    uint32_t index;

    crc = crc_of_byte(crc, (uint8_t)(data_id & 0xFFu));
    crc = crc_of_byte(crc, (uint8_t)(data_id >> 8u));
    for (index = 1u; index < 8u; index++) {
        crc = crc_of_byte(crc, data[index]);
    }
    return crc;
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

/* The counter is within its window; after a long silence or a jump it must prove itself first. */
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
        /* as it is */
    }
    self->no_new_or_repeated_data_counter = 0u;
    return result;
}

ARS_SECTION_CODE static ars_e2e_status_t check_counter(ars_e2e_receiver_t *self, uint8_t counter)
{
    const uint8_t range = counter_max + 1u;
    const uint8_t delta = (uint8_t)((uint8_t)(counter + range) - self->last_counter) % range;
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
        if (sync_counter_init > 0u) {
            self->max_delta_counter = max_delta_counter_init;
            self->last_counter = counter;
        }
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
