/*
 * Constants of the map and of the vehicle.
 *
 * Defined in ars_calibration.c, but no calibration: these bounds of the vehicle hold whatever the tables and parameters contain.
 * Caps are rounded down, so that rounding never exceeds the bound.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_CONSTANTS_H
#define ARS_CONSTANTS_H

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_CONSTANTS_BUILD 0xD8B70D2Bu

typedef struct {
    float lateral_acceleration_cap; /* m/s^2, largest steady one that the constraints allow */
    float lateral_acceleration_cap_per_friction; /* m/s^2, for a friction of 1, on slippery roads */
    float map_friction; /* friction of the road that the map assumes */
    float wheelbase; /* m */
    float understeer_coefficient; /* s^2/m */
    float rear_arm; /* m, centre of gravity to rear axle */
    float rear_slip_per_lateral_acceleration; /* rad s^2/m, rear axle */
    float sideslip_max; /* rad, bound of the optimisation */
    float rear_angle_max; /* rad, bound of the optimisation */
    float grip_max; /* m/s^2, lateral acceleration that the map allows on its road */
    float friction_per_grip; /* s^2/m, friction for each m/s^2 of it */
    float model_rear_slip_per_lateral_acceleration; /* rad s^2/m, the same of the reference model */
    float rear_slip_least; /* rad, half of the slip at which the rear tyres give their peak force */
    float rear_slip_per_friction; /* rad, the other half, for a friction of 1 */
} ars_constants_t;

extern const ars_constants_t ars_constants;

#ifdef __cplusplus
}
#endif

#endif /* ARS_CONSTANTS_H */
