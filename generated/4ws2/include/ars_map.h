/*
 * Yaw-rate reference map: the largest safe yaw rate over speed and front steering angle.
 *
 * Total: every pair of numbers has a finite answer. The table reaches from standstill to 33.33 m/s (120 km/h) and from zero to
 * 0.6109 rad (35 deg); beyond it the edge holds, and no answer asks for more than 5.073 m/s^2 of lateral
 * acceleration. Nothing here keeps a state or calls a library.
 *
 * Units are SI (m/s, rad, rad/s). Signs follow ISO 8855: front angle and yaw rate are positive to the left.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_MAP_H
#define ARS_MAP_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_MAP_BUILD 0x3CA513E9u

/* Breakpoints of the table. */
enum {
    ARS_MAP_SPEED_POINTS = 102,
    ARS_MAP_FRONT_ANGLE_POINTS = 102
};

/* What the optimum asks for. */
typedef struct {
    float yaw_rate;                 /* rad/s, with the sign of the front angle */
    float rear_angle;               /* rad, of the rear wheels in that turn; positive to the left */
    float lateral_acceleration_max; /* m/s^2, what the road is taken to allow */
} ars_map_reference_t;

/*
 * Reference yaw rate on the road that the map assumes (friction 0.9).
 *
 * speed:       m/s; NaN and what is below zero count as 0. Beyond the last breakpoint the last row holds, capped.
 * front_angle: rad at the road wheel; NaN counts as 0. Beyond the last breakpoint the last column holds.
 * Returns rad/s with the sign of front_angle; at most 5.073 m/s^2 / speed.
 */
float ars_map_yaw_rate(float speed, float front_angle);

/*
 * The same on a road of estimated friction: the bound on lateral acceleration shrinks with it.
 *
 * friction: peak friction; NaN, or more than the map assumes, counts as the map's own; what is below zero as 0.
 */
float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction);

/*
 * The same with the optimum's own rear angle, from one search of the axes. Where the road takes yaw rate away, the rear wheels
 * turn with the front ones by what the linear car needs for that, up to the sideslip bound of the map. At most 0.06109 rad (3.5 deg).
 */
ars_map_reference_t ars_map_reference(float speed, float front_angle, float friction);

/*
 * Whether every number of the map in memory may be used: no NaN, breakpoints that increase, those of an even axis in their even
 * places, ars_map_yaw_rate_table from 0.0f to 10.0f rad/s; ars_map_rear_angle_table from -0.5f to 0.5f rad.
 * Part of what ars_parameters_valid() asks.
 */
bool ars_map_valid(void);

/*
 * Return the checksum so far (ars_checksum.h) with the map in memory: the tables row by row, the speeds,
 * the front angles.
 */
uint32_t ars_map_crc(uint32_t start);

/*
 * The map itself, in ars_calibration.c. Read-only for the code; calibration may change it, and then asks
 * ars_parameters_valid().
 */
extern const float ars_map_speed_breakpoints[ARS_MAP_SPEED_POINTS]; /* m/s, even */
extern const float ars_map_front_angle_breakpoints[ARS_MAP_FRONT_ANGLE_POINTS]; /* rad, even */
extern const float ars_map_yaw_rate_table[ARS_MAP_SPEED_POINTS][ARS_MAP_FRONT_ANGLE_POINTS]; /* rad/s */
extern const float ars_map_rear_angle_table[ARS_MAP_SPEED_POINTS][ARS_MAP_FRONT_ANGLE_POINTS]; /* rad */

#ifdef __cplusplus
}
#endif

#endif /* ARS_MAP_H */
