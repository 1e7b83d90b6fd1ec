/*
 * The cyclic task. See ars_task.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_task.h"

#include "ars_sections.h"

#if ARS_CAN_BUILD != 0x474CE1C0u
#error "ars_can.h and this source come from different builds"
#endif
#if ARS_CONTROLLER_BUILD != 0x474CE1C0u
#error "ars_controller.h and this source come from different builds"
#endif
#if ARS_E2E_BUILD != 0x474CE1C0u
#error "ars_e2e.h and this source come from different builds"
#endif
#if ARS_TASK_BUILD != 0x474CE1C0u
#error "ars_task.h and this source come from different builds"
#endif

/* NaN is an input here; a compiler that may assume there is none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* Diagnostics of the second message lie so many bits above those of the first. */
ARS_SECTION_CONST static const uint32_t conditions_shift = 5u;

ARS_SECTION_CODE static void input_init(ars_task_input_t *self)
{
    ars_e2e_receiver_init(&self->receiver);
    self->causes = 0u;
    self->frames = 0u;
    self->good = false;
}

/* Returns whether the data may be used. */
ARS_SECTION_CODE static bool input_receive(ars_task_input_t *self, uint16_t data_id, const uint8_t *data)
{
    bool usable = false;

    if (self->frames < UINT8_MAX) {
        self->frames++;
    }
    switch (ars_e2e_check(&self->receiver, data_id, data)) {
    case ARS_E2E_OK:
    case ARS_E2E_INITIAL:
        usable = true;
        break;
    case ARS_E2E_OK_SOME_LOST:
        usable = true;
        self->causes |= (uint16_t)ARS_DIAGNOSTICS_MOTION_SOME_LOST;
        break;
    case ARS_E2E_WRONG_CRC:
        self->causes |= (uint16_t)ARS_DIAGNOSTICS_MOTION_WRONG_CRC;
        break;
    case ARS_E2E_REPEATED:
        self->causes |= (uint16_t)ARS_DIAGNOSTICS_MOTION_REPEATED;
        break;
    case ARS_E2E_SYNC:
    case ARS_E2E_WRONG_SEQUENCE:
    case ARS_E2E_NO_NEW_DATA: /* never of a frame that came */
    default:
        self->causes |= (uint16_t)ARS_DIAGNOSTICS_MOTION_WRONG_SEQUENCE;
        break;
    }
    self->good = self->good || usable;
    return usable;
}

/* The end of a cycle for one message: its diagnostics; ready for the next cycle. */
ARS_SECTION_CODE static uint32_t input_close(ars_task_input_t *self)
{
    uint32_t causes = self->causes;

    if (self->frames == 0u) {
        (void)ars_e2e_no_new_data(&self->receiver);
        causes |= (uint32_t)ARS_DIAGNOSTICS_MOTION_MISSING;
    }
    self->causes = 0u;
    self->frames = 0u;
    self->good = false;
    return causes;
}

ARS_SECTION_CODE void ars_task_init(ars_task_t *self, const ars_parameters_t *parameters)
{
    self->parameters = parameters;
    ars_controller_init(&self->controller, 0.0f);
    input_init(&self->motion_input);
    input_init(&self->conditions_input);
    self->motion.speed = ars_can_not_available();
    self->motion.front_angle = ars_can_not_available();
    self->motion.yaw_rate = ars_can_not_available();
    self->conditions.rear_angle = ars_can_not_available();
    self->conditions.friction = ars_can_not_available();
    self->conditions.inhibit = false;
    self->counter = 0u;
    self->wrong_length = false;
    self->conditions_close = false;
    self->started = false;
    self->samples_without_angle = 0u;
    self->cycles = 0u;
    self->late_cycles = 0u;
    self->early_cycles = 0u;
    self->lost_samples = 0u;
}

ARS_SECTION_CODE void ars_task_on_can_frame(ars_task_t *self, uint32_t id, const uint8_t *data, uint8_t length)
{
    const bool motion = id == (uint32_t)ARS_CAN_ID_VEHICLE_MOTION;
    const bool conditions = id == (uint32_t)ARS_CAN_ID_VEHICLE_CONDITIONS;

    if ((motion || conditions) && (length != (uint8_t)ARS_CAN_LENGTH)) {
        self->wrong_length = true;
    } else if (motion) {
        if (input_receive(&self->motion_input, (uint16_t)ARS_CAN_DATA_ID_VEHICLE_MOTION, data)) {
            ars_can_unpack_vehicle_motion(data, &self->motion);
        }
    } else if (conditions) {
        self->conditions_close = self->motion_input.frames > 0u;
        if (input_receive(&self->conditions_input, (uint16_t)ARS_CAN_DATA_ID_VEHICLE_CONDITIONS, data)) {
            ars_can_unpack_vehicle_conditions(data, &self->conditions);
        }
    } else {
        /* another node's */
    }
}

ARS_SECTION_CODE bool ars_task_is_complete(const ars_task_t *self)
{
    return self->conditions_close;
}

/* How often the task comes compared with the frames. */
ARS_SECTION_CODE static uint32_t check_rhythm(ars_task_t *self)
{
    uint32_t causes = 0u;

    self->cycles++;
    if ((self->motion_input.frames > 1u) || (self->conditions_input.frames > 1u)) {
        self->late_cycles++;
        causes = (uint32_t)ARS_DIAGNOSTICS_TASK_LATE;
    } else if ((self->motion_input.frames == 0u) && (self->conditions_input.frames == 0u)) {
        self->early_cycles++;
        causes = (uint32_t)ARS_DIAGNOSTICS_TASK_EARLY;
    } else {
        /* one frame of each, or one is missing */
    }
    return causes;
}

/* Control starts from the angle that the actuator holds. An angle that cannot be is waited out; one that is not available is
 * taken for a car that does not measure it, and for zero, only after as many samples as a recovery takes. */
ARS_SECTION_CODE static void start(ars_task_t *self)
{
    const float rear_angle = self->conditions.rear_angle;
    const float largest = self->parameters->inputs.rear_angle_max;

    if ((rear_angle >= -largest) && (rear_angle <= largest)) {
        self->started = true;
    } else if ((rear_angle > largest) || (rear_angle < -largest)) {
        self->samples_without_angle = 0u;
    } else {
        self->samples_without_angle++;
        self->started = self->samples_without_angle > self->parameters->inputs.recovery_samples;
    }
    if (self->started) {
        ars_controller_init(&self->controller, rear_angle);
    }
}

/* What did not come is told to the controller by signals that are not available. */
ARS_SECTION_CODE static ars_command_t step(ars_task_t *self)
{
    const bool motion_good = self->motion_input.good;
    const bool conditions_good = self->conditions_input.good;
    const float not_available = ars_can_not_available();
    const ars_measurement_t measurement = {
        .speed = motion_good ? self->motion.speed : not_available,
        .front_angle = motion_good ? self->motion.front_angle : not_available,
        .yaw_rate = motion_good ? self->motion.yaw_rate : not_available,
        .rear_angle = conditions_good ? self->conditions.rear_angle : not_available,
        .friction = conditions_good ? self->conditions.friction : not_available,
        .inhibit = self->conditions.inhibit
    };

    if (!motion_good || !conditions_good) {
        self->lost_samples++;
    } else if (!self->started) {
        start(self);
    } else {
        /* control goes on */
    }
    return ars_controller_step(&self->controller, self->parameters, &measurement);
}

/* What the controller had to say of a sample that came whole, and of samples that stayed lost. */
ARS_SECTION_CODE static uint32_t causes_of_controller(const ars_task_t *self, bool good)
{
    const ars_quality_t quality = self->controller.quality;
    uint32_t causes = 0u;

    if (good && (quality == ARS_QUALITY_MISSING)) {
        causes |= (uint32_t)ARS_DIAGNOSTICS_UNAVAILABLE;
    }
    if (quality == ARS_QUALITY_REPLACED) {
        causes |= (uint32_t)ARS_DIAGNOSTICS_REPLACED;
    }
    if (quality == ARS_QUALITY_UNUSABLE) {
        causes |= (uint32_t)ARS_DIAGNOSTICS_UNUSABLE;
    }
    return causes;
}

ARS_SECTION_CODE uint32_t ars_task_10ms(ars_task_t *self, uint8_t data[8])
{
    const bool good = self->motion_input.good && self->conditions_input.good;
    const ars_command_t command = step(self);
    uint32_t diagnostics = check_rhythm(self) | causes_of_controller(self, good);
    ars_rear_steer_command_t signals;

    self->conditions_close = false;
    diagnostics |= input_close(&self->motion_input);
    diagnostics |= input_close(&self->conditions_input) << conditions_shift;
    if (self->wrong_length) {
        diagnostics |= (uint32_t)ARS_DIAGNOSTICS_WRONG_LENGTH;
        self->wrong_length = false;
    }
    /* Before the first good sample nobody knows where the rear wheels stand: no angle is better than a wrong one. */
    signals.rear_angle = self->started ? command.rear_angle : ars_can_not_available();
    signals.yaw_rate_reference = self->started ? command.yaw_rate_reference : ars_can_not_available();
    signals.status = (uint8_t)command.status;
    signals.diagnostics = (uint16_t)diagnostics;
    ars_can_pack_rear_steer_command(&signals, data);
    ars_e2e_protect((uint16_t)ARS_CAN_DATA_ID_REAR_STEER_COMMAND, &self->counter, data);
    return (uint32_t)ARS_CAN_ID_REAR_STEER_COMMAND;
}
