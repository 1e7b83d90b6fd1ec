/*
 * The self-test. See ars_controller.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_controller.h"
#include "ars_e2e.h"
#include "ars_map.h"
#include "ars_sections.h"

#if ARS_CONTROLLER_BUILD != 0xC9A75925u
#error "ars_controller.h and this source come from different builds"
#endif
#if ARS_E2E_BUILD != 0xC9A75925u
#error "ars_e2e.h and this source come from different builds"
#endif
#if ARS_MAP_BUILD != 0xC9A75925u
#error "ars_map.h and this source come from different builds"
#endif

/* A lookup that gives NaN must fail the test; a compiler that may assume there is none would drop that. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const uint32_t crc_start = 0xFFFFFFFFu;

/* Check the CRC with the examples of AUTOSAR PRS_E2EProtocol, section 6.3.5 (data id 0x123, eight bytes of zero, counters 0 and 1), and
 * with a weighted sum that uses every entry of the table once. */
ARS_SECTION_CODE static bool crc_is_right(void)
{
    uint8_t data[8] = { 0u, 0u, 0u, 0u, 0u, 0u, 0u, 0u };
    bool is_right = ars_e2e_crc(0x123u, data) == 0xCCu;
    uint32_t sum = 0u;
    uint32_t value;

    data[1] = 1u;
    is_right = is_right && (ars_e2e_crc(0x123u, data) == 0x91u);
    for (value = 0u; value < 256u; value++) {
        data[7] = (uint8_t)value;
        sum += (value + 1u) * ars_e2e_crc(0x123u, data);
    }
    return is_right && (sum == 4194240u);
}

/* Checksum of the calibration, continued from that of the map, which comes first. */
ARS_SECTION_CODE static uint32_t with_the_rest(uint32_t map_crc)
{
    return ~ars_reference_model_crc(ars_parameters_crc(map_crc));
}

ARS_SECTION_CODE uint32_t ars_calibration_checksum(void)
{
    return with_the_rest(ars_map_crc(crc_start));
}

ARS_SECTION_CODE bool ars_selftest(void)
{
    /* speed, front angle, friction, and the yaw rate that the lookup gave at build */
    ARS_SECTION_CONST static const float examples[14][4] = {
        { 0.0f, 0.0f, 0.9f, 0.0f },
        { 0.0f, 0.61086524f, 0.9f, 0.0f },
        { 33.333332f, 0.0f, 0.9f, 0.0f },
        { 33.333332f, 0.61086524f, 0.9f, 0.23541377f },
        { 33.333332f, -0.61086524f, 0.9f, -0.23541377f },
        { 13.333333f, 0.061086524f, 0.9f, 0.32798624f },
        { 13.333333f, -0.061086524f, 0.9f, -0.32798624f },
        { 1.6666666f, 0.30543262f, 0.9f, 0.1945329f },
        { 40.0f, 0.0061086523f, 0.9f, 0.029284373f },
        { 1.0f, 0.91629785f, 0.9f, 0.21397206f },
        { 50.0f, 1.2217305f, 0.9f, 0.15694252f },
        { 33.333332f, 0.61086524f, 0.882f, 0.2307055f },
        { 50.0f, 0.61086524f, 0.918f, 0.15694252f },
        { 33.333332f, 0.61086524f, 0.36f, 0.09416552f }
    };
    const float tolerance = 1.0e-05f; /* rad/s: a compiler may fuse multiply and add */
    const uint32_t map_crc = ars_map_crc(crc_start);
    bool passed = crc_is_right()
        && (with_the_rest(map_crc) == ars_calibration_expected_checksum)
        && ars_parameters_valid(&ars_parameters_default);

    if (~map_crc == 0xA48BF090u) { /* the map of the build, not changed by calibration */
        uint32_t index;

        for (index = 0u; index < 14u; index++) {
            const float yaw_rate = ars_map_yaw_rate_on_road(examples[index][0], examples[index][1], examples[index][2]);
            passed = passed && (yaw_rate >= (examples[index][3] - tolerance)) && (yaw_rate <= (examples[index][3] + tolerance));
        }
    }
    return passed;
}
