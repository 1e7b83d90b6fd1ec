/*
 * Checksum of the calibration: CRC-32 (IEEE 802.3) over its numbers.
 *
 * Each number enters with its bits, least significant byte first, so that the result depends neither on the byte order of the machine
 * nor on padding. Start with 0xFFFFFFFF and invert all bits of the last result.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_CHECKSUM_H
#define ARS_CHECKSUM_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_CHECKSUM_BUILD 0xC9A75925u

/* Return crc, the checksum so far, continued with one number of 4 bytes. NaN and infinity enter with their bits. */
uint32_t ars_checksum_real(uint32_t crc, float value);

/* Return crc, the checksum so far, continued with one whole number of two bytes. */
uint32_t ars_checksum_whole(uint32_t crc, uint16_t value);

#ifdef __cplusplus
}
#endif

#endif /* ARS_CHECKSUM_H */
