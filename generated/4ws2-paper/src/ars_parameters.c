/*
 * Parameters of the controller. See ars_parameters.h.
 *
 * Their values are in ars_calibration.c.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_parameters.h"

#include "ars_checksum.h"
#include "ars_map.h"
#include "ars_sections.h"

#if ARS_CHECKSUM_BUILD != 0x76CDF87Cu
#error "ars_checksum.h and this source come from different builds"
#endif
#if ARS_MAP_BUILD != 0x76CDF87Cu
#error "ars_map.h and this source come from different builds"
#endif
#if ARS_PARAMETERS_BUILD != 0x76CDF87Cu
#error "ars_parameters.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* Return whether the value is between low and high; false for NaN. */
ARS_SECTION_CODE static bool is_between(float value, float low, float high)
{
    return (value >= low) && (value <= high);
}

ARS_SECTION_CODE bool ars_parameters_valid(const ars_parameters_t *parameters)
{
    return is_between(parameters->proportional_gain, 0.0f, 2.0f)
        && is_between(parameters->integral_gain, 0.01f, 20.0f)
        && is_between(parameters->rear_angle_error_max, 0.0017453292f, 1.0f)
        && is_between(parameters->rear_angle_max, 1.0e-04f, 0.061086524f)
        && is_between(parameters->rear_rate_max, 0.017453292f, 1000.0f)
        && is_between(parameters->friction_min, 0.02f, 0.5f)
        && is_between(parameters->enable_speed, 0.1388889f, 27.777779f)
        && is_between(parameters->disable_speed, 0.027777778f, 27.777779f)
        && is_between(parameters->standby_rate, 0.0034906585f, 1.7453293f)
        && is_between(parameters->fail_safe_rate, 0.0034906585f, 1.7453293f)
        && is_between(parameters->actuator_share, 1.0e-04f, 1.0f)
        && is_between(parameters->actuator_error_max, 1.0e-04f, 1.5f)
        && (parameters->rear_angle_max <= parameters->inputs.rear_angle_max)
        && (parameters->disable_speed < parameters->enable_speed)
        && (parameters->enable_speed <= (0.5f * ars_map_speed_breakpoints[ARS_MAP_SPEED_POINTS - 1u]))
        && (parameters->inputs.speed_max >= ars_map_speed_breakpoints[ARS_MAP_SPEED_POINTS - 1u])
        && (parameters->inputs.speed_max <= parameters->limiter.speed_max)
        && (parameters->inputs.front_angle_max <= parameters->limiter.front_angle_max)
        && (parameters->actuator_samples_max >= 1u)
        && (parameters->actuator_samples_max <= 60000u)
        && (parameters->inhibit_samples_max >= 1u)
        && (parameters->inhibit_samples_max <= 60000u)
        && (parameters->limiter.rear_angle_max <= parameters->rear_angle_max)
        && ars_inputs_parameters_valid(&parameters->inputs)
        && ars_limiter_parameters_valid(&parameters->limiter)
        && ars_map_valid();
}

ARS_SECTION_CODE uint32_t ars_parameters_crc(uint32_t start)
{
    const ars_parameters_t *const parameters = &ars_parameters_default;
    uint32_t crc = start;
    uint32_t k;

    crc = ars_checksum_real(crc, parameters->proportional_gain);
    crc = ars_checksum_real(crc, parameters->integral_gain);
    crc = ars_checksum_real(crc, parameters->rear_angle_error_max);
    crc = ars_checksum_real(crc, parameters->rear_angle_max);
    crc = ars_checksum_real(crc, parameters->rear_rate_max);
    crc = ars_checksum_real(crc, parameters->friction_min);
    crc = ars_checksum_real(crc, parameters->enable_speed);
    crc = ars_checksum_real(crc, parameters->disable_speed);
    crc = ars_checksum_real(crc, parameters->standby_rate);
    crc = ars_checksum_real(crc, parameters->fail_safe_rate);
    crc = ars_checksum_real(crc, parameters->actuator_share);
    crc = ars_checksum_real(crc, parameters->actuator_error_max);
    crc = ars_checksum_whole(crc, parameters->actuator_samples_max);
    crc = ars_checksum_whole(crc, parameters->inhibit_samples_max);
    crc = ars_checksum_real(crc, parameters->inputs.speed_max);
    crc = ars_checksum_real(crc, parameters->inputs.front_angle_max);
    crc = ars_checksum_real(crc, parameters->inputs.yaw_rate_max);
    crc = ars_checksum_real(crc, parameters->inputs.rear_angle_max);
    crc = ars_checksum_real(crc, parameters->inputs.friction_max);
    crc = ars_checksum_real(crc, parameters->inputs.speed_step);
    crc = ars_checksum_real(crc, parameters->inputs.front_angle_step);
    crc = ars_checksum_real(crc, parameters->inputs.yaw_rate_step);
    crc = ars_checksum_real(crc, parameters->inputs.wheelbase);
    crc = ars_checksum_real(crc, parameters->inputs.understeer_coefficient);
    crc = ars_checksum_real(crc, parameters->inputs.expected_share);
    crc = ars_checksum_real(crc, parameters->inputs.yaw_rate_tolerance);
    crc = ars_checksum_real(crc, parameters->inputs.lateral_acceleration_max);
    crc = ars_checksum_real(crc, parameters->inputs.yaw_rate_frozen);
    crc = ars_checksum_real(crc, parameters->inputs.speed_agreement);
    crc = ars_checksum_real(crc, parameters->inputs.yaw_rate_agreement);
    crc = ars_checksum_real(crc, parameters->inputs.straight_yaw_rate);
    crc = ars_checksum_real(crc, parameters->inputs.yaw_rate_offset_max);
    crc = ars_checksum_real(crc, parameters->inputs.lateral_acceleration_offset_max);
    crc = ars_checksum_real(crc, parameters->inputs.yaw_rate_correction_share);
    crc = ars_checksum_real(crc, parameters->inputs.speed_fall);
    crc = ars_checksum_real(crc, parameters->inputs.friction_recovery);
    crc = ars_checksum_whole(crc, parameters->inputs.missing_samples_max);
    crc = ars_checksum_whole(crc, parameters->inputs.recovery_samples);
    crc = ars_checksum_real(crc, parameters->limiter.rear_angle_max);
    crc = ars_checksum_real(crc, parameters->limiter.rear_rate_max);
    for (k = 0u; k < (uint32_t)ARS_LIMITER_POINTS; k++) {
        crc = ars_checksum_real(crc, parameters->limiter.opposite_phase_speed[k]);
    }
    for (k = 0u; k < (uint32_t)ARS_LIMITER_POINTS; k++) {
        crc = ars_checksum_real(crc, parameters->limiter.opposite_phase_max[k]);
    }
    crc = ars_checksum_real(crc, parameters->limiter.in_phase_from_front_angle);
    crc = ars_checksum_real(crc, parameters->limiter.speed_max);
    crc = ars_checksum_real(crc, parameters->limiter.front_angle_max);
    return crc;
}
