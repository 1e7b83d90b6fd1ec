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

#define ARS_CONSTANTS_BUILD 0xC9A75925u

typedef struct {
    float lateral_acceleration_cap; /* m/s^2, largest steady lateral acceleration that the constraints allow */
    float lateral_acceleration_cap_per_friction; /* m/s^2, largest lateral acceleration on slippery roads, per unit of friction */
    float map_friction; /* road friction that the map assumes */
    float wheelbase; /* m, wheelbase of the linear car */
    float understeer_coefficient; /* s^2/m, understeer coefficient of the linear car */
    float rear_arm; /* m, distance from centre of gravity to rear axle */
    float rear_slip_per_lateral_acceleration; /* rad s^2/m, rear slip angle per lateral acceleration */
    float sideslip_max; /* rad, sideslip bound of the optimisation */
    float rear_angle_max; /* rad, rear angle bound of the optimisation */
    float grip_max; /* m/s^2, largest lateral acceleration of the map on its road */
    float friction_per_grip; /* s^2/m, friction per lateral acceleration */
    float model_rear_slip_per_lateral_acceleration; /* rad s^2/m, rear slip angle per lateral acceleration of the model */
    float rear_slip_least; /* rad, rear slip angle at peak force: constant part */
    float rear_slip_per_friction; /* rad, rear slip angle at peak force: part that grows with friction, per unit of friction */
} ars_constants_t;

extern const ars_constants_t ars_constants;

#ifdef __cplusplus
}
#endif

#endif /* ARS_CONSTANTS_H */
