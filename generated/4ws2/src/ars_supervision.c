/*
 * Supervision of the task. See ars_supervision.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_supervision.h"

#include "ars_sections.h"

#if ARS_SUPERVISION_BUILD != 0xC9A75925u
#error "ars_supervision.h and this source come from different builds"
#endif

/* Next state for each cause, from every state that ars_supervision_step() does not name. */
ARS_SECTION_CONST static const ars_supervision_state_t next_state[11] = {
    ARS_SUPERVISION_RESYNCHRONISE, /* ANGLE_UNKNOWN */
    ARS_SUPERVISION_STANDBY, /* STANDBY */
    ARS_SUPERVISION_LOST, /* SAMPLE_LOST */
    ARS_SUPERVISION_PREDICTED, /* SAMPLE_MISSING */
    ARS_SUPERVISION_DEGRADED, /* SIGNAL_REPLACED */
    ARS_SUPERVISION_DEGRADED, /* ACTUATOR_STUCK */
    ARS_SUPERVISION_DEGRADED, /* TASK_LATE */
    ARS_SUPERVISION_DEGRADED, /* CONDITIONS_UNKNOWN */
    ARS_SUPERVISION_DEGRADED, /* BUS_INTERMITTENT */
    ARS_SUPERVISION_INHIBITED, /* INHIBIT */
    ARS_SUPERVISION_RUN /* NONE */
};

/* Status that is sent in each state. */
ARS_SECTION_CONST static const ars_status_t status_of[8] = {
    ARS_STATUS_FAIL_SAFE,
    ARS_STATUS_TRACKING,
    ARS_STATUS_DEGRADED,
    ARS_STATUS_DEGRADED,
    ARS_STATUS_FAIL_SAFE,
    ARS_STATUS_FAIL_SAFE,
    ARS_STATUS_STANDBY,
    ARS_STATUS_TRACKING
};

/* Whether a command is sent in each state. */
ARS_SECTION_CONST static const bool has_command_in[8] = {
    false,
    true,
    true,
    true,
    true,
    false,
    true,
    true
};

ARS_SECTION_CODE void ars_supervision_init(ars_supervision_t *self)
{
    self->state = ARS_SUPERVISION_START;
    self->cause = ARS_CAUSE_ANGLE_UNKNOWN;
    self->status = status_of[ARS_SUPERVISION_START];
    self->has_command = has_command_in[ARS_SUPERVISION_START];
}

ARS_SECTION_CODE ars_status_t ars_supervision_step(
    ars_supervision_t *self, ars_supervision_cause_t cause, ars_status_t status)
{
    ars_supervision_state_t state = next_state[cause];
    ars_status_t sent;

    if ((self->state == ARS_SUPERVISION_START) && (cause == ARS_CAUSE_ANGLE_UNKNOWN)) {
        state = ARS_SUPERVISION_START;
    }
    sent = status_of[state];
    self->state = state;
    self->cause = cause;
    self->has_command = has_command_in[state];
    self->status = ((sent == ARS_STATUS_TRACKING) && (status == ARS_STATUS_LIMITED)) ? status : sent;
    return self->status;
}
