/*
 * Constants of the map and of the vehicle.
 *
 * Defined in ars_calibration.c, but no calibration: these bounds of the vehicle hold whatever the tables and parameters contain.
 * Caps are rounded down, so that rounding never exceeds the bound.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_CONSTANTS_H
#define ARS_CONSTANTS_H

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_CONSTANTS_BUILD 0x76CDF87Cu

typedef struct {
    float lateral_acceleration_cap; /* m/s^2, largest steady lateral acceleration that the constraints allow */
    float lateral_acceleration_cap_per_friction; /* m/s^2, largest lateral acceleration on slippery roads, per unit of friction */
    float map_friction; /* road friction that the map assumes */
} ars_constants_t;

extern const ars_constants_t ars_constants;

#ifdef __cplusplus
}
#endif

#endif /* ARS_CONSTANTS_H */
