/*
 * Yaw-rate reference map: bilinear lookup. See ars_map.h.
 *
 * All numbers are in ars_calibration.c.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_map.h"

#include "ars_checksum.h"
#include "ars_constants.h"
#include "ars_sections.h"

#if ARS_CHECKSUM_BUILD != 0xC9A75925u
#error "ars_checksum.h and this source come from different builds"
#endif
#if ARS_CONSTANTS_BUILD != 0xC9A75925u
#error "ars_constants.h and this source come from different builds"
#endif
#if ARS_MAP_BUILD != 0xC9A75925u
#error "ars_map.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* Position on an axis: index of the breakpoint below, and fraction (0 to 1) of the way to the next one. */
typedef struct {
    uint32_t lower;
    float fraction;
} position_t;

/* Position in the table. */
typedef struct {
    position_t row;
    position_t column;
} place_t;

/* Limits of the road. */
typedef struct {
    float lateral_acceleration_max; /* m/s^2 */
} road_t;

/* Return the number without its sign bit. Faster than a comparison: one instruction. */
ARS_SECTION_CODE static float magnitude(float value)
{
    union {
        float value;
        uint32_t bits;
    } number = { .value = value };

    number.bits &= 0x7FFFFFFFu;
    return number.value;
}

/* Speed: even but for the first cell. NaN and what is below zero count as zero; beyond the last breakpoint the last one holds. */
ARS_SECTION_CODE static position_t locate_speed(float speed)
{
    const float *const breakpoints = ars_map_speed_breakpoints;
    const float steps = ((speed - breakpoints[1]) / (breakpoints[118] - breakpoints[1])) * 117.0f;
    position_t position = { 0u, 0.0f };

    if (steps >= 117.0f) {
        position.lower = 117u;
        position.fraction = 1.0f;
    } else if (speed >= breakpoints[1]) {
        const uint32_t whole = (uint32_t)steps;

        position.lower = whole + 1u;
        position.fraction = steps - (float)whole;
    } else if (speed > 0.0f) {
        position.fraction = speed / breakpoints[1];
    } else {
        /* zero, below it, or NaN */
    }
    return position;
}

/* Front angle: even but for the last cell. Not negative; NaN counts as zero; beyond the last breakpoint the last one holds. */
ARS_SECTION_CODE static position_t locate_front_angle(float front_angle_magnitude)
{
    const float *const breakpoints = ars_map_front_angle_breakpoints;
    position_t position = { 0u, 0.0f };

    if (front_angle_magnitude < breakpoints[100]) {
        const float steps = (front_angle_magnitude / breakpoints[100]) * 100.0f;
        const uint32_t whole = (uint32_t)steps;

        position.lower = whole;
        position.fraction = steps - (float)whole;
    } else if (front_angle_magnitude >= breakpoints[100]) {
        const float fraction = (front_angle_magnitude - breakpoints[100]) / (breakpoints[101] - breakpoints[100]);

        position.lower = 100u;
        position.fraction = (fraction < 1.0f) ? fraction : 1.0f;
    } else {
        /* NaN */
    }
    return position;
}

/* All tables are for positive front angles and share this search. */
ARS_SECTION_CODE static place_t place_of(float speed, float front_angle_magnitude)
{
    const place_t place = { locate_speed(speed), locate_front_angle(front_angle_magnitude) };

    return place;
}

ARS_SECTION_CODE static road_t road_of(float friction)
{
    road_t road = { ars_constants.lateral_acceleration_cap }; /* for NaN too */

    if (friction <= 0.0f) {
        road.lateral_acceleration_max = 0.0f;
    } else if (friction < ars_constants.map_friction) {
        road.lateral_acceleration_max = ars_constants.lateral_acceleration_cap_per_friction * friction;
    } else {
        /* the map's own */
    }
    return road;
}

ARS_SECTION_CODE static float interpolate(
    const float table[][ARS_MAP_FRONT_ANGLE_POINTS], const place_t *place)
{
    const float *const slower = &table[place->row.lower][place->column.lower];
    const float *const faster = &table[place->row.lower + 1u][place->column.lower];
    const float left = slower[0] + (place->row.fraction * (faster[0] - slower[0]));
    const float right = slower[1] + (place->row.fraction * (faster[1] - slower[1]));

    return left + (place->column.fraction * (right - left));
}

/* rad/s, before the road's cap. */
ARS_SECTION_CODE static float uncapped_yaw_rate(const place_t *place)
{
    return interpolate(ars_map_yaw_rate_table, place);
}

/* rad, before the road's cap. */
ARS_SECTION_CODE static float rear_angle_of_table(const place_t *place)
{
    return interpolate(ars_map_rear_angle_table, place);
}

ARS_SECTION_CODE static float capped(float yaw_rate, float speed, const road_t *road)
{
    float result = yaw_rate;

    if ((yaw_rate * speed) > road->lateral_acceleration_max) {
        result = road->lateral_acceleration_max / speed;
    }
    return result;
}

ARS_SECTION_CODE static float yaw_rate_at(float speed, float front_angle_magnitude, const road_t *road)
{
    const place_t place = place_of(speed, front_angle_magnitude);

    return capped(uncapped_yaw_rate(&place), speed, road);
}

/* The map is an odd function of the front angle. */
ARS_SECTION_CODE float ars_map_yaw_rate_on_road(
    float speed, float front_angle, float friction)
{
    const road_t road = road_of(friction);
    const float yaw_rate = yaw_rate_at(speed, magnitude(front_angle), &road);

    return (front_angle < 0.0f) ? -yaw_rate : yaw_rate;
}

ARS_SECTION_CODE float ars_map_yaw_rate(float speed, float front_angle)
{
    return ars_map_yaw_rate_on_road(speed, front_angle, ars_constants.map_friction);
}

/* Rear angle of a capped yaw rate: the rear wheels steer in phase by the angle that the linear vehicle needs for the reduction, as far
 * as its sideslip stays within the bound. */
ARS_SECTION_CODE static float capped_rear_angle(float rear_angle, float yaw_rate_excess, float yaw_rate, float speed)
{
    const float understeer_coefficient = ars_constants.understeer_coefficient;
    const float rear_slip_per_lateral_acceleration = ars_constants.rear_slip_per_lateral_acceleration;
    const float speed_max = ars_map_speed_breakpoints[118];
    const float bounded_speed = (speed > speed_max) ? speed_max : speed;
    const float sideslip_per_yaw_rate
        = (ars_constants.rear_arm / bounded_speed) - (rear_slip_per_lateral_acceleration * bounded_speed);
    const float sideslip_bound = ars_constants.sideslip_max - (yaw_rate * sideslip_per_yaw_rate);
    float rear_angle_demand
        = rear_angle + (yaw_rate_excess * ((ars_constants.wheelbase / bounded_speed) + (understeer_coefficient * bounded_speed)));

    if (rear_angle_demand > sideslip_bound) {
        rear_angle_demand = sideslip_bound;
    }
    if (rear_angle_demand > ars_constants.rear_angle_max) {
        rear_angle_demand = ars_constants.rear_angle_max;
    }
    return (rear_angle_demand > rear_angle) ? rear_angle_demand : rear_angle;
}

ARS_SECTION_CODE ars_map_reference_t ars_map_reference(
    float speed, float front_angle, float friction)
{
    const road_t road = road_of(friction);
    const place_t place = place_of(speed, magnitude(front_angle));
    const float yaw_rate = uncapped_yaw_rate(&place);
    ars_map_reference_t reference;

    reference.yaw_rate = yaw_rate;
    reference.rear_angle = rear_angle_of_table(&place);
    reference.lateral_acceleration_max = road.lateral_acceleration_max;
    if ((yaw_rate * speed) > road.lateral_acceleration_max) { /* capped as in the other look-ups */
        reference.yaw_rate = road.lateral_acceleration_max / speed;
        reference.rear_angle
            = capped_rear_angle(reference.rear_angle, yaw_rate - reference.yaw_rate, reference.yaw_rate, speed);
    }
    if (front_angle < 0.0f) {
        reference.yaw_rate = -reference.yaw_rate;
        reference.rear_angle = -reference.rear_angle;
    }
    return reference;
}

/* Return whether all numbers are between low and high; false for NaN. */
ARS_SECTION_CODE static bool are_between(const float *numbers, uint32_t count, float low, float high)
{
    bool all_between = true;
    uint32_t k;

    for (k = 0u; k < count; k++) {
        all_between = all_between && (numbers[k] >= low) && (numbers[k] <= high);
    }
    return all_between;
}

/* Return whether breakpoints start at zero or below and increase strictly. */
ARS_SECTION_CODE static bool are_increasing(const float *breakpoints, uint32_t count)
{
    bool increasing = breakpoints[0] <= 0.0f;
    uint32_t k;

    for (k = 1u; k < count; k++) {
        increasing = increasing && (breakpoints[k - 1u] < breakpoints[k]);
    }
    return increasing;
}

/* Return whether breakpoints have equal steps within a tolerance. The search relies on it: it uses the first and last one only. */
ARS_SECTION_CODE static bool are_even(const float *breakpoints, uint32_t cells)
{
    const float step = (breakpoints[cells] - breakpoints[0]) / (float)cells;
    const float tolerance = 0.01f * step;
    bool even = true;
    uint32_t k;

    for (k = 1u; k < cells; k++) {
        const float deviation = (breakpoints[k] - breakpoints[0]) - ((float)k * step);
        even = even && (deviation >= -tolerance) && (deviation <= tolerance);
    }
    return even;
}

ARS_SECTION_CODE bool ars_map_valid(void)
{
    bool valid = are_between(ars_map_speed_breakpoints, (uint32_t)ARS_MAP_SPEED_POINTS, 0.0f, 150.0f);
    uint32_t row;

    valid = valid && are_between(ars_map_front_angle_breakpoints, (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS, 0.0f, 1.2f);
    valid = valid && are_increasing(ars_map_speed_breakpoints, (uint32_t)ARS_MAP_SPEED_POINTS);
    valid = valid && are_even(&ars_map_speed_breakpoints[1], 117u);
    valid = valid && are_increasing(ars_map_front_angle_breakpoints, (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS);
    valid = valid && are_even(&ars_map_front_angle_breakpoints[0], 100u);
    for (row = 0u; row < (uint32_t)ARS_MAP_SPEED_POINTS; row++) {
        valid = valid && are_between(ars_map_yaw_rate_table[row], (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS, 0.0f, 10.0f);
        valid = valid && are_between(ars_map_rear_angle_table[row], (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS, -0.5f, 0.5f);
    }
    return valid;
}

ARS_SECTION_CODE static uint32_t crc_of(uint32_t start, const float *numbers, uint32_t count)
{
    uint32_t crc = start;
    uint32_t index;

    for (index = 0u; index < count; index++) {
        crc = ars_checksum_real(crc, numbers[index]);
    }
    return crc;
}

ARS_SECTION_CODE uint32_t ars_map_crc(uint32_t start)
{
    uint32_t crc = start;
    uint32_t row;
    for (row = 0u; row < (uint32_t)ARS_MAP_SPEED_POINTS; row++) {
        crc = crc_of(crc, ars_map_yaw_rate_table[row], (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS);
    }
    for (row = 0u; row < (uint32_t)ARS_MAP_SPEED_POINTS; row++) {
        crc = crc_of(crc, ars_map_rear_angle_table[row], (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS);
    }
    crc = crc_of(crc, ars_map_speed_breakpoints, (uint32_t)ARS_MAP_SPEED_POINTS);
    crc = crc_of(crc, ars_map_front_angle_breakpoints, (uint32_t)ARS_MAP_FRONT_ANGLE_POINTS);
    return crc;
}
