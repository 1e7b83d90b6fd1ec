/*
 * Checksum of the calibration. See ars_checksum.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_checksum.h"

#include "ars_sections.h"

#if ARS_CHECKSUM_BUILD != 0xC9A75925u
#error "ars_checksum.h and this source come from different builds"
#endif

/* The checksum covers the bits of each number, NaN included; a compiler that assumes there is no NaN could change them. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* A number and its bits. */
typedef union {
    float value;
    uint32_t bits;
} number_t;

/* Continue a CRC with the lowest four of bits. Polynomial 0x04C11DB7, reflected. */
ARS_SECTION_CODE static uint32_t crc_step(uint32_t crc, uint32_t bits)
{
    ARS_SECTION_CONST static const uint32_t table[16] = {
        0x00000000u, 0x1DB71064u, 0x3B6E20C8u, 0x26D930ACu, 0x76DC4190u, 0x6B6B51F4u, 0x4DB26158u, 0x5005713Cu,
        0xEDB88320u, 0xF00F9344u, 0xD6D6A3E8u, 0xCB61B38Cu, 0x9B64C2B0u, 0x86D3D2D4u, 0xA00AE278u, 0xBDBDF21Cu
    };

    return table[(crc ^ bits) & 0xFu] ^ (crc >> 4u);
}

ARS_SECTION_CODE uint32_t ars_checksum_real(uint32_t crc, float value)
{
    const number_t number = { .value = value };
    uint32_t result = crc;
    uint32_t shift;

    for (shift = 0u; shift < 32u; shift += 4u) {
        result = crc_step(result, (uint32_t)(number.bits >> shift));
    }
    return result;
}

ARS_SECTION_CODE uint32_t ars_checksum_whole(uint32_t crc, uint16_t value)
{
    const uint32_t bits = value;
    uint32_t result = crc;
    uint32_t shift;

    for (shift = 0u; shift < 16u; shift += 4u) {
        result = crc_step(result, bits >> shift);
    }
    return result;
}
