/*
 * Supervision of the task: one table of states and causes.
 *
 * In each sample the task finds the most urgent cause and calls ars_supervision_step(). The table gives the next state for the state so far
 * and the cause. The state gives the status that is sent, and whether there is a command:
 *
 *     state          status     reaction
 *     START          FAIL_SAFE  no command ("not available"), the actuator holds its angle
 *     RUN            TRACKING   the command of the control law
 *     PREDICTED      DEGRADED   the command of the control law, which continues from the last sample
 *     DEGRADED       DEGRADED   the command of the control law
 *     LOST           FAIL_SAFE  the command returns to zero at a limited rate, from the measured angle if that is farther out, and waits for wheels that do not follow
 *     RESYNCHRONISE  FAIL_SAFE  no command ("not available"), the actuator holds its angle
 *     STANDBY        STANDBY    the command returns to zero at a limited rate; before the first speed, it is held
 *     INHIBITED      TRACKING   the command of the control law
 *
 * TRACKING becomes LIMITED while the command is at a limit. While a cause holds the integrator, the law keeps what it has learned.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#ifndef ARS_SUPERVISION_H
#define ARS_SUPERVISION_H

#include <stdbool.h>
#include <stdint.h>

#include "ars_controller.h"

#if ARS_CONTROLLER_BUILD != 0x76CDF87Cu
#error "ars_controller.h and this source come from different builds"
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define ARS_SUPERVISION_BUILD 0x76CDF87Cu

/* State of the supervision. */
typedef enum {
    ARS_SUPERVISION_START = 0,         /* the rear angle has not been known since the start */
    ARS_SUPERVISION_RUN = 1,           /* nothing is wrong */
    ARS_SUPERVISION_PREDICTED = 2,     /* a signal is missing for a short time */
    ARS_SUPERVISION_DEGRADED = 3,      /* a signal is replaced, or the loop is impaired */
    ARS_SUPERVISION_LOST = 4,          /* neither front angle nor yaw rate is valid */
    ARS_SUPERVISION_RESYNCHRONISE = 5, /* after a silence, the rear angle is not yet measured again */
    ARS_SUPERVISION_STANDBY = 6,       /* without control */
    ARS_SUPERVISION_INHIBITED = 7      /* the car inhibits the integrator */
} ars_supervision_state_t;

/* Cause of a sample. If there are several, the first one of this list counts. */
typedef enum {
    ARS_CAUSE_ANGLE_UNKNOWN = 0,      /* no rear angle to start from, at the start or after a silence */
    ARS_CAUSE_STANDBY = 1,            /* no speed was received yet, Inhibit is set for good, or the speed is below the enabling one (kind `pi`) */
    ARS_CAUSE_SAMPLE_LOST = 2,        /* front angle and yaw rate are lost or rejected */
    ARS_CAUSE_SAMPLE_MISSING = 3,     /* a signal is missing, for a tolerated time so far */
    ARS_CAUSE_SIGNAL_REPLACED = 4,    /* a signal is rejected and computed from the others */
    ARS_CAUSE_ACTUATOR_STUCK = 5,     /* the rear angle does not follow the command */
    ARS_CAUSE_TASK_LATE = 6,          /* the task is called too rarely */
    ARS_CAUSE_CONDITIONS_UNKNOWN = 7, /* the conditions are not valid: it is unknown whether the car inhibits the integrator */
    ARS_CAUSE_BUS_INTERMITTENT = 8,   /* the bus is disturbed again and again */
    ARS_CAUSE_INHIBIT = 9,            /* the car sets Inhibit */
    ARS_CAUSE_NONE = 10               /* none */
} ars_supervision_cause_t;

/* Causes that hold the integrator: bit k for the cause k. They are known before the step of the controller. */
#define ARS_CAUSES_HOLDING 0x03E0u

/* State of one supervision. Measurement systems may read it. */
typedef struct {
    ars_supervision_state_t state;
    ars_supervision_cause_t cause;    /* cause of the last sample */
    ars_status_t status;              /* status to send */
    bool has_command;                  /* a command is sent; else the rear angle is unknown, and the frame has "not available" */
} ars_supervision_t;

/* Start without a rear angle. */
void ars_supervision_init(ars_supervision_t *self);

/* Take the cause of a sample. Returns the status to send.
 *
 * status: status of the controller; distinguishes TRACKING from LIMITED. */
ars_status_t ars_supervision_step(ars_supervision_t *self, ars_supervision_cause_t cause, ars_status_t status);

#ifdef __cplusplus
}
#endif

#endif /* ARS_SUPERVISION_H */
