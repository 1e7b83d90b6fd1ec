/*
 * Single-track vehicle dynamics for observers and reference models.
 *
 * The vehicle of the map with linear and with Magic Formula tyres, and the Jacobians of both models, derived symbolically with CasADi.
 * Library functions used: atanf, cosf, sinf.
 *
 * Units are SI. Signs follow ISO 8855. Every function is defined for all finite arguments. A speed below
 * 1 m/s, or NaN, counts as that speed, because the slip angles are unbounded at standstill.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_DYNAMICS_H
#define ARS_DYNAMICS_H

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_DYNAMICS_BUILD 0xC9A75925u

/* State of the vehicle, or its time derivative in units per second. */
typedef struct {
    float sideslip_angle; /* rad, at the centre of gravity */
    float yaw_rate; /* rad/s */
} ars_dynamics_state_t;

/* Inputs of the vehicle. */
typedef struct {
    float speed; /* m/s, forward */
    float front_angle; /* rad, at the road wheel */
    float rear_angle; /* rad */
    float friction; /* peak friction coefficient of the road; no effect on linear tyres */
} ars_dynamics_input_t;

/* Jacobian. Rows: derivatives of sideslip angle and yaw rate. Columns: fields of the state and of the input. */
typedef struct {
    float state[2][2];
    float input[2][4];
} ars_dynamics_jacobian_t;

/* Time derivative of the state with linear tyres. */
ars_dynamics_state_t ars_dynamics_linear(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input);

/* Jacobian of this model at the same point. */
ars_dynamics_jacobian_t ars_dynamics_linear_jacobian(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input);

/* Time derivative of the state with Magic Formula tyres at static wheel loads. */
ars_dynamics_state_t ars_dynamics_magic_formula(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input);

/* Jacobian of this model at the same point. */
ars_dynamics_jacobian_t ars_dynamics_magic_formula_jacobian(
    const ars_dynamics_state_t *state, const ars_dynamics_input_t *input);

#ifdef __cplusplus
}
#endif

#endif /* ARS_DYNAMICS_H */
