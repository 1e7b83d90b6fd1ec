/*
 * Yaw-rate reference map: the largest safe yaw rate over speed and front steering angle.
 *
 * The lookup returns a finite value for every pair of numbers. The table covers speeds from standstill to 33.33 m/s (120 km/h) and front
 * angles from zero to 0.6109 rad (35 deg). Beyond it, the value at the edge applies; no result demands more than 7.847 m/s^2 of lateral
 * acceleration. The functions have no state and call no library.
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

#define ARS_MAP_BUILD 0xC9A75925u

/* Numbers of breakpoints. */
enum {
    ARS_MAP_SPEED_POINTS = 119,
    ARS_MAP_FRONT_ANGLE_POINTS = 102
};

/* Result of a lookup of yaw rate and rear angle. */
typedef struct {
    float yaw_rate;                 /* rad/s, with the sign of the front angle */
    float rear_angle;               /* rad, of the rear wheels in that steady turn; positive to the left */
    float lateral_acceleration_max; /* m/s^2, lateral acceleration that the road allows */
} ars_map_reference_t;

/*
 * Return the reference yaw rate on the road that the map assumes (friction 0.9).
 *
 * speed:       m/s, any number; NaN and negative speeds count as 0. Beyond the last breakpoint the last row applies, capped.
 * front_angle: rad at the road wheel, any number; NaN counts as 0. Beyond the last breakpoint the last column applies.
 * Returns rad/s with the sign of front_angle, finite, with a magnitude of at most 7.847 m/s^2 / speed.
 */
float ars_map_yaw_rate(float speed, float front_angle);

/*
 * Return the reference yaw rate on a road of the given friction: the bound on lateral acceleration shrinks with it.
 *
 * friction: peak friction coefficient, any number; NaN, and more than the map assumes, count as the map's own, negative values as 0.
 */
float ars_map_yaw_rate_on_road(float speed, float front_angle, float friction);

/*
 * Return this yaw rate and the rear angle of the optimum, from a single search of the axes. Where the road reduces the yaw rate, the
 * rear wheels steer in phase by the angle that the linear vehicle needs for the reduction, up to the sideslip bound of the map.
 * The rear angle is at most 0.06109 rad (3.5 deg).
 */
ars_map_reference_t ars_map_reference(float speed, float front_angle, float friction);

/*
 * Return whether every number of the map in memory is usable: no NaN, increasing breakpoints, equal steps on an even axis, and
 * ars_map_yaw_rate_table from 0.0f to 10.0f rad/s; ars_map_rear_angle_table from -0.5f to 0.5f rad.
 * ars_parameters_valid() includes this check.
 */
bool ars_map_valid(void);

/*
 * Return start, the checksum so far (ars_checksum.h), continued with the map in memory: the tables row by row, the speeds,
 * the front angles.
 */
uint32_t ars_map_crc(uint32_t start);

/*
 * The map, defined in ars_calibration.c. Read-only for the code. Call ars_parameters_valid() after a change by
 * calibration.
 */
extern const float ars_map_speed_breakpoints[ARS_MAP_SPEED_POINTS]; /* m/s, even */
extern const float ars_map_front_angle_breakpoints[ARS_MAP_FRONT_ANGLE_POINTS]; /* rad, even */
extern const float ars_map_yaw_rate_table[ARS_MAP_SPEED_POINTS][ARS_MAP_FRONT_ANGLE_POINTS]; /* rad/s */
extern const float ars_map_rear_angle_table[ARS_MAP_SPEED_POINTS][ARS_MAP_FRONT_ANGLE_POINTS]; /* rad */

#ifdef __cplusplus
}
#endif

#endif /* ARS_MAP_H */
