/*
 * The cyclic task: receive, check, control, pack, send.
 *
 * Give ars_task_on_can_frame() every frame that the CAN driver receives, call ars_task_10ms() every 10 ms and send what it
 * returns. The two must not interrupt each other on one ars_task_t: call both from one task, or hand frames over through a queue.
 * There is no clock in here: time is the number of calls.
 *
 * A sample needs a good frame of both VehicleMotion and VehicleConditions; else it counts as lost, and the
 * controller holds its last command, then goes to the fail-safe. Until the first good sample with a measured rear angle the command
 * is sent as "not available"; then the controller starts from the angle that the actuator holds.
 *
 * Map 4ws2-tracking: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_TASK_H
#define ARS_TASK_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_can.h"
#include "ars_controller.h"
#include "ars_e2e.h"

#if ARS_CAN_BUILD != 0xF83727A6u
#error "ars_can.h and this source come from different builds"
#endif
#if ARS_CONTROLLER_BUILD != 0xF83727A6u
#error "ars_controller.h and this source come from different builds"
#endif
#if ARS_E2E_BUILD != 0xF83727A6u
#error "ars_e2e.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_TASK_BUILD 0xF83727A6u

/* Bits of the signal "Diagnostics": what was seen since the call before. */
enum {
    ARS_DIAGNOSTICS_MOTION_MISSING = 0x0001u, /* VehicleMotion: no frame in this cycle */
    ARS_DIAGNOSTICS_MOTION_WRONG_CRC = 0x0002u, /* VehicleMotion: a frame with a wrong CRC */
    ARS_DIAGNOSTICS_MOTION_REPEATED = 0x0004u, /* VehicleMotion: a frame whose counter did not advance */
    ARS_DIAGNOSTICS_MOTION_WRONG_SEQUENCE = 0x0008u, /* VehicleMotion: a counter that jumped, or must prove itself again */
    ARS_DIAGNOSTICS_MOTION_SOME_LOST = 0x0010u, /* VehicleMotion: frames were lost in between, few enough to go on */
    ARS_DIAGNOSTICS_CONDITIONS_MISSING = 0x0020u, /* VehicleConditions: no frame in this cycle */
    ARS_DIAGNOSTICS_CONDITIONS_WRONG_CRC = 0x0040u, /* VehicleConditions: a frame with a wrong CRC */
    ARS_DIAGNOSTICS_CONDITIONS_REPEATED = 0x0080u, /* VehicleConditions: a frame whose counter did not advance */
    ARS_DIAGNOSTICS_CONDITIONS_WRONG_SEQUENCE = 0x0100u, /* VehicleConditions: a counter that jumped, or must prove itself again */
    ARS_DIAGNOSTICS_CONDITIONS_SOME_LOST = 0x0200u, /* VehicleConditions: frames were lost in between, few enough to go on */
    ARS_DIAGNOSTICS_UNAVAILABLE = 0x0400u, /* front angle or yaw rate is not available, out of range or impossible */
    ARS_DIAGNOSTICS_REPLACED = 0x0800u, /* a signal is replaced by what the others say */
    ARS_DIAGNOSTICS_TASK_LATE = 0x1000u, /* a message came more than once since the last call of the task */
    ARS_DIAGNOSTICS_TASK_EARLY = 0x2000u, /* no message came since the last call of the task */
    ARS_DIAGNOSTICS_WRONG_LENGTH = 0x4000u, /* a frame that has not eight bytes */
    ARS_DIAGNOSTICS_UNUSABLE = 0x8000u  /* neither front angle nor yaw rate is believed */
};

/* One received message. Private. */
typedef struct {
    ars_e2e_receiver_t receiver;
    uint16_t causes;                    /* diagnostics of this message, from bit 0, since the last call */
    uint8_t frames;                     /* that came since the last call */
    bool good;                          /* and one of them may be used */
} ars_task_input_t;

/* One task. The counters at the end are for the caller to read; the rest is private. */
typedef struct {
    const ars_parameters_t *parameters;
    ars_controller_t controller;
    ars_task_input_t motion_input;
    ars_task_input_t conditions_input;
    ars_vehicle_motion_t motion;            /* last good one */
    ars_vehicle_conditions_t conditions;    /* last good one */
    uint8_t counter;                            /* of the next command */
    bool wrong_length;                          /* a frame without eight bytes came since the last call */
    bool conditions_close;                      /* a frame of the conditions came after one of the motion: a set is complete */
    bool started;                               /* a good sample with a rear angle to start from was seen */
    uint16_t samples_without_angle;             /* good ones before that, in which it was not available */
    uint32_t cycles;                            /* calls; wraps around, as the others do */
    uint32_t late_cycles;                       /* calls that found a message more than once: the task came late */
    uint32_t early_cycles;                      /* calls that found no message: the task came twice, or the bus is silent */
    uint32_t lost_samples;                      /* calls without a good sample */
} ars_task_t;

/* Before the first call. parameters stay the caller's and must be valid for as long as the task runs. */
void ars_task_init(ars_task_t *self, const ars_parameters_t *parameters);

/*
 * A frame came from the bus. Only classical data frames with 11-bit identifiers may be given; foreign identifiers are ignored.
 *
 * data: length bytes; not read where the length is wrong.
 */
void ars_task_on_can_frame(ars_task_t *self, uint32_t id, const uint8_t *data, uint8_t length);

/* Whether both messages of the car came since the last call, good or not, VehicleConditions last: what triggers a call where
 * there is no timer. */
bool ars_task_is_complete(const ars_task_t *self);

/*
 * One sample. Writes the eight bytes of the frame to send and returns its identifier.
 */
uint32_t ars_task_10ms(ars_task_t *self, uint8_t data[8]);

#ifdef __cplusplus
}
#endif

#endif /* ARS_TASK_H */
