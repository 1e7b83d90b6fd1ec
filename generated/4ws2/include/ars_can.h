/*
 * Packing and unpacking of the CAN frames that ars.dbc describes.
 *
 * Classical CAN with 11-bit identifiers and eight data bytes; every message is sent every 10 ms. A value out of range
 * saturates. NaN is sent as "not available", which unpacking returns as NaN. Packing sets CRC and counter to zero; ars_e2e_protect()
 * writes them. The byte order of the machine does not matter.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_CAN_H
#define ARS_CAN_H

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_CAN_BUILD 0xC9A75925u

enum {
    ARS_CAN_LENGTH = 8, /* bytes of every frame */
    ARS_CAN_ID_VEHICLE_MOTION = 0x101,
    ARS_CAN_DATA_ID_VEHICLE_MOTION = 0x0101,
    ARS_CAN_ID_VEHICLE_CONDITIONS = 0x102,
    ARS_CAN_DATA_ID_VEHICLE_CONDITIONS = 0x0102,
    ARS_CAN_ID_REAR_STEER_COMMAND = 0x201,
    ARS_CAN_DATA_ID_REAR_STEER_COMMAND = 0x0201
};

/* VehicleMotion, 0x101, from the car: what the car does. */
typedef struct {
    float speed;                /* m/s, speed, negative in reverse; NaN: not available */
    float front_angle;          /* rad, front angle at the road wheel, positive to the left; NaN: not available */
    float yaw_rate;             /* rad/s, yaw rate, positive to the left; NaN: not available */
} ars_vehicle_motion_t;

/* VehicleConditions, 0x102, from the car: what else the controller should know of the car. */
typedef struct {
    float rear_angle;           /* rad, rear angle at the road wheel, positive to the left; NaN: not available */
    float friction;             /* estimated peak friction; NaN: not available */
    float lateral_acceleration; /* m/s^2, lateral acceleration at the centre of gravity, positive to the left; NaN: not available */
    bool inhibit;               /* 1 = ESC or ABS is acting, the integrator holds */
} ars_vehicle_conditions_t;

/* RearSteerCommand, 0x201, from the controller: what the controller asks for. */
typedef struct {
    float rear_angle;           /* rad, rear angle at the road wheel, positive to the left; NaN: not available */
    float yaw_rate_reference;   /* rad/s, reference yaw rate from the map; NaN: not available */
    uint8_t status;             /* what the controller did */
    uint16_t diagnostics;       /* one bit for each cause of trouble */
} ars_rear_steer_command_t;

/*
 * Pack and unpack each message. No argument may be null. Packing accepts every number; it keeps the low bits of a whole number
 * that is too large for its signal. Unpacking accepts every frame and checks neither CRC nor counter.
 */
void ars_can_pack_vehicle_motion(const ars_vehicle_motion_t *signals, uint8_t data[8]);
void ars_can_unpack_vehicle_motion(const uint8_t data[8], ars_vehicle_motion_t *signals);

void ars_can_pack_vehicle_conditions(const ars_vehicle_conditions_t *signals, uint8_t data[8]);
void ars_can_unpack_vehicle_conditions(const uint8_t data[8], ars_vehicle_conditions_t *signals);

void ars_can_pack_rear_steer_command(const ars_rear_steer_command_t *signals, uint8_t data[8]);
void ars_can_unpack_rear_steer_command(const uint8_t data[8], ars_rear_steer_command_t *signals);

/* Return a quiet NaN, the value of a signal that is not available. */
float ars_can_not_available(void);

#ifdef __cplusplus
}
#endif

#endif /* ARS_CAN_H */
