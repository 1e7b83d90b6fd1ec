/*
 * The cyclic task: receive and check frames, run the controller, pack the command.
 *
 * Pass every frame that the CAN driver receives to ars_task_on_can_frame(). Call ars_task_10ms() every 10 ms and send the frame that it
 * writes. The two functions must not interrupt each other on one ars_task_t: call both from one task, or pass frames through a
 * queue. The code reads no clock; it measures time in calls.
 *
 * A sample is good if a good frame of both VehicleMotion and VehicleConditions was received and both messages are valid over the last
 * 6 cycles (ars_e2e.h). Otherwise its signals are missing: the controller predicts for a few samples, then replaces them or, without front
 * angle and yaw rate, enters the fail-safe. Until the first good sample with a measured rear angle the command is sent as "not
 * available"; then the controller starts from the angle that the actuator holds. After a silence of both messages that led to the
 * fail-safe it is sent as "not available" again until the rear angle is measured, for at most 100 ms; the fail-safe then
 * starts from the measured angle, or else from the last measured one. If the car never measures it, the ramp starts from the last command.
 * If only VehicleConditions was silent and the measured angle differs from the expected one, the command starts from the measured angle.
 * A return to zero waits for wheels that do not follow it, and the command for a stuck actuator stays near the wheels.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_TASK_H
#define ARS_TASK_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_can.h"
#include "ars_controller.h"
#include "ars_e2e.h"
#include "ars_supervision.h"

#if ARS_CAN_BUILD != 0xC9A75925u
#error "ars_can.h and this source come from different builds"
#endif
#if ARS_CONTROLLER_BUILD != 0xC9A75925u
#error "ars_controller.h and this source come from different builds"
#endif
#if ARS_E2E_BUILD != 0xC9A75925u
#error "ars_e2e.h and this source come from different builds"
#endif
#if ARS_SUPERVISION_BUILD != 0xC9A75925u
#error "ars_supervision.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_TASK_BUILD 0xC9A75925u

/* Bits of the signal "Diagnostics": events since the previous call. Both messages MISSING: the task
 * ran early, or the bus is silent. */
enum {
    ARS_DIAGNOSTICS_MOTION_MISSING = 0x0001u, /* VehicleMotion: no frame in this cycle */
    ARS_DIAGNOSTICS_MOTION_WRONG_CRC = 0x0002u, /* VehicleMotion: a frame with a wrong CRC, or without eight bytes */
    ARS_DIAGNOSTICS_MOTION_WRONG_COUNTER = 0x0004u, /* VehicleMotion: a wrong counter, or too few valid frames since the start or a fault */
    ARS_DIAGNOSTICS_CONDITIONS_MISSING = 0x0008u, /* VehicleConditions: no frame in this cycle */
    ARS_DIAGNOSTICS_CONDITIONS_WRONG_CRC = 0x0010u, /* VehicleConditions: a frame with a wrong CRC, or without eight bytes */
    ARS_DIAGNOSTICS_CONDITIONS_WRONG_COUNTER = 0x0020u, /* VehicleConditions: a wrong counter, or too few valid frames since the start or a fault */
    ARS_DIAGNOSTICS_UNAVAILABLE = 0x0040u, /* a signal is not available, out of range or implausible, for a short time so far */
    ARS_DIAGNOSTICS_SPEED_REPLACED = 0x0080u, /* the speed is rejected: last value, then decreasing */
    ARS_DIAGNOSTICS_FRONT_ANGLE_REPLACED = 0x0100u, /* the front angle is rejected: computed from the yaw rate */
    ARS_DIAGNOSTICS_YAW_RATE_REPLACED = 0x0200u, /* the yaw rate is rejected: computed from the front angle */
    ARS_DIAGNOSTICS_TASK_LATE = 0x0400u, /* the task is called less often than frames arrive */
    ARS_DIAGNOSTICS_INTERMITTENT = 0x0800u, /* repeated disturbances of the bus */
    ARS_DIAGNOSTICS_ACTUATOR_STUCK = 0x1000u  /* the measured rear angle does not follow the command */
};

/* State of one received message. Private. */
typedef struct {
    ars_e2e_receiver_t receiver;
    ars_e2e_supervision_t supervision;
    uint16_t causes;                    /* diagnostics of this message since the last call, from bit 0 */
    uint8_t frames;                     /* frames received since the last call */
    uint8_t advance;                    /* steps of the sender's counter in good frames since the last call; 0: none */
    bool out_of_sequence;               /* new data were received since the last call, with a counter that jumped */
    bool disturbed;                     /* an error or a loss since the last good frame */
    bool usable;                        /* in this sample: a good frame was received, and the message is valid */
} ars_task_input_t;

/* State of one task. The caller may read the supervision and the counters at the end; the rest is private. */
typedef struct {
    const ars_parameters_t *parameters;
    ars_controller_t controller;
    ars_supervision_t supervision;              /* its state and cause may be read */
    ars_task_input_t motion_input;
    ars_task_input_t conditions_input;
    ars_vehicle_motion_t motion;            /* last good message */
    ars_vehicle_conditions_t conditions;    /* last good message */
    uint8_t counter;                            /* E2E counter of the next command frame */
    uint8_t backlog;                            /* periods by which the calls are behind the sender */
    uint8_t disturbance;                        /* level of recent disturbances of the bus */
    uint16_t actuator_samples;                  /* samples in which the actuator did not follow, minus samples in which it did */
    bool is_stuck;                              /* the actuator counts as stuck; cleared when actuator_samples is back at 0 */
    uint16_t inhibited_samples;                 /* consecutive samples with Inhibit */
    float expected_angle;                       /* rad, rear angle of an actuator that follows the command */
    float measured_angle;                       /* rad, last measured and plausible rear angle */
    bool has_measured;                          /* the car measures the rear angle: a plausible one was received */
    float start_angle;                          /* rad, rear angle at which control began or ended */
    float stuck_angle;                          /* rad, measured rear angle when the actuator began to count as stuck */
    float angle_offset;                         /* rad, measured minus expected angle when control ended, if they differed */
    bool deviates;                              /* the measured angle differs from the expected one */
    bool released;                              /* control ended in the last call */
    bool conditions_close;                      /* conditions were received after the motion: the set is complete */
    uint16_t samples_without_angle;             /* samples without a rear angle before the start or after a silence */
    uint16_t waited_samples;                    /* samples in which the return to zero waited for the wheels */
    uint8_t silent_calls;                       /* consecutive calls without new data */
    uint32_t cycles;                            /* calls; wraps around, as the other counters do */
    uint32_t late_cycles;                       /* calls with more than one frame of a message: the task ran late */
    uint32_t early_cycles;                      /* calls without a frame: the task ran early, or the bus is silent */
    uint32_t lost_samples;                      /* calls without a good sample */
} ars_task_t;

/*
 * Initialise a task. Without this call, the first frame or call of ars_task_10ms() initialises memory without the mark of
 * ars_controller_init(), whatever it contains, with ars_parameters_default.
 *
 * parameters: owned by the caller; must be valid, and stay so while the task runs.
 */
void ars_task_init(ars_task_t *self, const ars_parameters_t *parameters);

/*
 * Process a received frame. Pass only classical data frames with 11-bit identifiers; other nodes' identifiers are ignored.
 *
 * data: length bytes; not read if the length is wrong, and the frame then counts as received with a wrong CRC.
 */
void ars_task_on_can_frame(ars_task_t *self, uint32_t id, const uint8_t *data, uint8_t length);

/* Return whether both messages of the car were received since the last call, good or not, VehicleConditions last. A program
 * without a timer runs the task then. */
bool ars_task_is_complete(const ars_task_t *self);

/*
 * Run one sample. Writes the eight bytes of the frame to send into data and returns its CAN identifier.
 */
uint32_t ars_task_10ms(ars_task_t *self, uint8_t data[8]);

#ifdef __cplusplus
}
#endif

#endif /* ARS_TASK_H */
