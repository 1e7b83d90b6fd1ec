/*
 * The cyclic task. See ars_task.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_task.h"

#include "ars_sections.h"

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
#if ARS_TASK_BUILD != 0xC9A75925u
#error "ars_task.h and this source come from different builds"
#endif

/* NaN is an input here; a compiler that may assume there is none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* Shift from the diagnostics of the first message to those of the second, in bits. */
ARS_SECTION_CONST static const uint32_t conditions_shift = 3u;

/* Periods that the calls may be behind the sender; drift and jitter of the two clocks explain up to two. One is forgiven every 64
 * calls: the drift of two quartz clocks takes thousands of calls for one period. advance_max steps at once fill the backlog. */
ARS_SECTION_CONST static const uint32_t backlog_max = 3u;
ARS_SECTION_CONST static const uint32_t forgiven_every = 64u;
ARS_SECTION_CONST static const uint8_t advance_max = 6u;

/* Each recovery from a disturbance adds the weight, each call without one subtracts one. Above the limit the bus is intermittent; it
 * remains so while there is a disturbance in every fifteen calls. */
ARS_SECTION_CONST static const uint32_t disturbance_weight = 15u;
ARS_SECTION_CONST static const uint32_t disturbance_max = 60u;

/* Samples in which the command waits for the rear angle, 100 ms. */
ARS_SECTION_CONST static const uint32_t angle_wait_max = 10u;

/* Samples in which a return to zero waits for the wheels, 5 s. */
ARS_SECTION_CONST static const uint16_t wait_samples_max = 500u;

/* Return the number without its sign bit. Faster than a comparison: one instruction. */
ARS_SECTION_CODE static float magnitude(float value)
{
    union {
        float value;
        uint32_t bits;
    } number = { .value = value };

    number.bits &= 0x7FFFFFFFu;
    return number.value;
}

/* Return the value within +-largest. NaN gives +largest, so that it cannot enter the state. */
ARS_SECTION_CODE static float bounded(float value, float largest)
{
    float result = largest;

    if (magnitude(value) <= largest) {
        result = value;
    } else if (value < 0.0f) {
        result = -largest;
    } else {
        /* above, or NaN */
    }
    return result;
}

ARS_SECTION_CODE static void input_init(ars_task_input_t *self)
{
    ars_e2e_receiver_init(&self->receiver);
    ars_e2e_supervision_init(&self->supervision);
    self->causes = 0u;
    self->frames = 0u;
    self->advance = 0u;
    self->out_of_sequence = false;
    self->disturbed = false;
    self->usable = false;
}

ARS_SECTION_CODE static void input_disturb(ars_task_input_t *self, uint32_t cause)
{
    self->causes |= (uint16_t)cause;
    self->disturbed = true;
}

/* Check a frame of the right length. Returns whether its data may be used. */
ARS_SECTION_CODE static bool input_check(ars_task_input_t *self, uint16_t data_id, const uint8_t *data)
{
    const ars_e2e_status_t status = ars_e2e_check(&self->receiver, data_id, data);
    uint8_t advance = 0u;

    if ((status == ARS_E2E_OK) || (status == ARS_E2E_INITIAL)) {
        advance = 1u;
    } else if (status == ARS_E2E_OK_SOME_LOST) {
        advance = 2u;
        input_disturb(self, 0u);
    } else if (status == ARS_E2E_WRONG_CRC) {
        input_disturb(self, (uint32_t)ARS_DIAGNOSTICS_MOTION_WRONG_CRC);
    } else {
        if ((status == ARS_E2E_SYNC) || (status == ARS_E2E_WRONG_SEQUENCE)) {
            self->out_of_sequence = true;
        }
        input_disturb(self, (uint32_t)ARS_DIAGNOSTICS_MOTION_WRONG_COUNTER);
    }
    if (self->advance < advance_max) {
        self->advance = (uint8_t)(self->advance + advance);
    }
    return advance > 0u;
}

/* Receive a frame. Returns whether its data may be used. */
ARS_SECTION_CODE static bool input_receive(ars_task_input_t *self, uint16_t data_id, const uint8_t *data, uint8_t length)
{
    bool is_good = false;

    if (self->frames < UINT8_MAX) {
        self->frames++;
    }
    if (length == (uint8_t)ARS_CAN_LENGTH) {
        is_good = input_check(self, data_id, data);
    } else { /* the data are not read: the frame counts as damaged and does not update the counter check */
        input_disturb(self, (uint32_t)ARS_DIAGNOSTICS_MOTION_WRONG_CRC);
    }
    return is_good;
}

/* Return whether a good frame was received after an error or a loss. */
ARS_SECTION_CODE static bool input_returned(const ars_task_input_t *self)
{
    return self->disturbed && (self->advance > 0u);
}

/* Return whether new data were received, usable or not. */
ARS_SECTION_CODE static bool input_is_heard(const ars_task_input_t *self)
{
    return (self->advance > 0u) || self->out_of_sequence;
}

/* End a cycle of one message: return its diagnostics and prepare the next cycle. */
ARS_SECTION_CODE static uint32_t input_close(ars_task_input_t *self)
{
    const bool is_good = self->advance > 0u;
    const bool is_damaged = (self->causes & (uint16_t)ARS_DIAGNOSTICS_MOTION_WRONG_CRC) != 0u;
    const bool is_valid = ars_e2e_supervise(&self->supervision, is_good, is_damaged) == ARS_E2E_STATE_VALID;
    uint32_t causes = self->causes;

    if (self->frames == 0u) {
        (void)ars_e2e_no_new_data(&self->receiver);
        causes |= (uint32_t)ARS_DIAGNOSTICS_MOTION_MISSING;
    }
    self->usable = is_good && is_valid;
    if (is_good) {
        self->disturbed = false;
        if (!is_valid) {
            causes |= (uint32_t)ARS_DIAGNOSTICS_MOTION_WRONG_COUNTER;
        }
    }
    self->causes = 0u;
    self->frames = 0u;
    self->advance = 0u;
    self->out_of_sequence = false;
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
    self->conditions.lateral_acceleration = ars_can_not_available();
    self->conditions.inhibit = false;
    self->counter = 0u;
    self->backlog = 0u;
    self->disturbance = 0u;
    self->actuator_samples = 0u;
    self->is_stuck = false;
    self->inhibited_samples = 0u;
    self->expected_angle = 0.0f;
    self->measured_angle = 0.0f;
    self->start_angle = 0.0f;
    self->stuck_angle = 0.0f;
    self->angle_offset = 0.0f;
    self->has_measured = false;
    self->deviates = false;
    self->released = false;
    self->waited_samples = 0u;
    self->conditions_close = false;
    ars_supervision_init(&self->supervision);
    self->samples_without_angle = 0u;
    self->silent_calls = 0u;
    self->cycles = 0u;
    self->late_cycles = 0u;
    self->early_cycles = 0u;
    self->lost_samples = 0u;
}

/* Initialise memory that ars_task_init() has not initialised, whatever it contains. */
ARS_SECTION_CODE static void start_memory(ars_task_t *self)
{
    if (self->controller.initialised != (uint32_t)ARS_CONTROLLER_INITIALISED) {
        ars_task_init(self, &ars_parameters_default);
    }
}

ARS_SECTION_CODE void ars_task_on_can_frame(ars_task_t *self, uint32_t id, const uint8_t *data, uint8_t length)
{
    start_memory(self);
    if (id == (uint32_t)ARS_CAN_ID_VEHICLE_MOTION) {
        if (input_receive(&self->motion_input, (uint16_t)ARS_CAN_DATA_ID_VEHICLE_MOTION, data, length)) {
            ars_can_unpack_vehicle_motion(data, &self->motion);
        }
    } else if (id == (uint32_t)ARS_CAN_ID_VEHICLE_CONDITIONS) {
        self->conditions_close = self->motion_input.frames > 0u;
        if (input_receive(&self->conditions_input, (uint16_t)ARS_CAN_DATA_ID_VEHICLE_CONDITIONS, data, length)) {
            ars_can_unpack_vehicle_conditions(data, &self->conditions);
        }
    } else {
        /* a frame of another node */
    }
}

ARS_SECTION_CODE bool ars_task_is_complete(const ars_task_t *self)
{
    return (self->controller.initialised == (uint32_t)ARS_CONTROLLER_INITIALISED) && self->conditions_close;
}

/* Compare the rate of the calls with that of the frames. Single late calls are normal with independent clocks. The task is late if its
 * calls fall further and further behind the counter of the first message. */
ARS_SECTION_CODE static uint32_t check_rhythm(ars_task_t *self)
{
    uint32_t backlog = (uint32_t)self->backlog + self->motion_input.advance;

    self->cycles++;
    if ((self->motion_input.frames > 1u) || (self->conditions_input.frames > 1u)) {
        self->late_cycles++;
    } else if ((self->motion_input.frames == 0u) && (self->conditions_input.frames == 0u)) {
        self->early_cycles++;
    } else {
        /* one frame of each, or one is missing */
    }
    if (backlog > 0u) { /* this call processes one step */
        backlog--;
    }
    if ((backlog > 0u) && ((self->cycles % forgiven_every) == 0u)) {
        backlog--;
    }
    if (backlog > (backlog_max + 2u)) { /* a margin of two: a forgiven step does not end the event */
        backlog = backlog_max + 2u;
    }
    self->backlog = (uint8_t)backlog;
    return (backlog > backlog_max) ? (uint32_t)ARS_DIAGNOSTICS_TASK_LATE : 0u;
}

/* Detect a bus that is disturbed and recovers repeatedly. A permanent fault does not count. */
ARS_SECTION_CODE static uint32_t check_bus(ars_task_t *self)
{
    uint32_t disturbance = self->disturbance;

    if (input_returned(&self->motion_input) || input_returned(&self->conditions_input)) {
        disturbance += disturbance_weight;
        if (disturbance > (disturbance_max + disturbance_weight)) {
            disturbance = disturbance_max + disturbance_weight;
        }
    } else if (disturbance > 0u) {
        disturbance--;
    } else {
        /* undisturbed */
    }
    self->disturbance = (uint8_t)disturbance;
    return (disturbance > disturbance_max) ? (uint32_t)ARS_DIAGNOSTICS_INTERMITTENT : 0u;
}

/* Start from the angle that the actuator holds. */
ARS_SECTION_CODE static void start_from(ars_task_t *self, float rear_angle)
{
    ars_controller_place(&self->controller, rear_angle);
    self->expected_angle = self->controller.rear_angle;
    self->start_angle = self->controller.rear_angle;
    self->angle_offset = 0.0f;
    self->deviates = false;
}

/* Return whether an angle is farther from zero than another. */
ARS_SECTION_CODE static bool is_outer(float angle, float other)
{
    return magnitude(angle) > magnitude(other);
}

/* Return whether the wheels of a stuck actuator have moved, or are near zero. The command is kept near stuck wheels, so that agreement
 * alone shows nothing. Near zero it counts, since the command could not lead the wheels out of there. */
ARS_SECTION_CODE static bool has_come_free(const ars_task_t *self)
{
    const float error_max = self->parameters->actuator_error_max;
    const float angle = self->conditions.rear_angle;

    return (magnitude(angle) <= error_max) || (magnitude(angle - self->stuck_angle) > error_max);
}

/* Check that the measured rear angle follows the previous commands with the lag of the actuator. The tolerance grows by twice the
 * remaining angle, which covers twice the nominal lag and two samples of delay. An angle that is not measured (NaN) counts as no
 * difference. The count rises only under control. A stuck actuator must follow for actuator_samples_max samples in a row, because a
 * changing command crosses the angle of a stuck actuator repeatedly.
 *
 * When control ends, the return to zero starts from the command, or from the measured angle if that is farther from zero. If measured
 * and expected angle differ then, sensor, actuator or bus is at fault. The difference is subtracted until they agree again, so that a
 * wrong sensor cannot turn the wheels. was_valid: whether the conditions were valid in the previous call. If they become valid with
 * another angle, commands may have been lost too, and the command starts from that angle. */
ARS_SECTION_CODE static uint32_t check_actuator(ars_task_t *self, bool is_measured, bool was_valid)
{
    const ars_parameters_t *parameters = self->parameters;
    const float command = self->controller.rear_angle;
    const float lagged_angle = self->expected_angle + (parameters->actuator_share * (command - self->expected_angle));
    const float plausible_angle_max = parameters->inputs.rear_angle_max;
    /* NaN is replaced by the command: it would persist in the filter. */
    const float expected = (magnitude(lagged_angle) <= plausible_angle_max) ? lagged_angle : command;
    const float remaining_angle = magnitude(command - expected);
    const float tolerance = parameters->actuator_error_max + (remaining_angle + remaining_angle);
    float angle_error = self->conditions.rear_angle - expected;
    uint32_t samples = self->actuator_samples;

    self->expected_angle = expected;
    if (self->conditions_input.usable && (magnitude(angle_error) <= tolerance)) {
        self->angle_offset = 0.0f; /* the sensor is right: the wheels had not followed */
    }
    angle_error -= self->angle_offset;
    self->deviates = self->conditions_input.usable && (magnitude(angle_error) > tolerance);
    if (is_measured && self->released && self->deviates) {
        self->angle_offset = angle_error;
        self->deviates = false;
    } else if (is_measured && !self->is_stuck
               && ((self->released && is_outer(self->conditions.rear_angle, command)) || (self->deviates && !was_valid))) {
        start_from(self, self->conditions.rear_angle);
    } else if (self->deviates) {
        if (self->is_stuck) {
            samples = parameters->actuator_samples_max;
        } else if (self->controller.enabled) {
            samples++;
            self->is_stuck = samples > parameters->actuator_samples_max;
            self->stuck_angle = self->conditions.rear_angle;
        } else {
            /* without control */
        }
    } else if (self->conditions_input.usable && (samples > 0u) && (!self->is_stuck || has_come_free(self))) {
        samples--;
        self->is_stuck = self->is_stuck && (samples > 0u);
    } else {
        /* the actuator follows, has not moved since it stuck, or the angle is not received */
    }
    self->actuator_samples = (uint16_t)samples;
    return self->is_stuck ? (uint32_t)ARS_DIAGNOSTICS_ACTUATOR_STUCK : 0u;
}

/* Replace a last command that was damaged in memory by its copy in the limiter: the measured angle is compared with it. */
ARS_SECTION_CODE static void keep_command_sound(ars_task_t *self)
{
    if (!(magnitude(self->controller.rear_angle) <= self->parameters->inputs.rear_angle_max)) { /* true for NaN */
        ars_controller_place(&self->controller, self->controller.limiter.rear_angle);
    }
}

/* Return whether the rear angle is unknown: until the start, and from the first new data after a silence in which the controller entered
 * the fail-safe. The actuator may have missed the commands too and still hold an old angle. After a wait in which no angle came, a further
 * silence is not waited for until the angle is measured again. */
ARS_SECTION_CODE static bool lacks_angle(ars_task_t *self)
{
    bool lacks = !self->supervision.has_command;

    if (!input_is_heard(&self->motion_input) && !input_is_heard(&self->conditions_input)) {
        if (self->silent_calls < UINT8_MAX) {
            self->silent_calls++;
        }
    } else {
        if ((self->silent_calls > self->parameters->inputs.missing_samples_max) && self->has_measured
            && (self->samples_without_angle <= angle_wait_max)) {
            lacks = true;
        }
        self->silent_calls = 0u;
    }
    return lacks;
}

/* Start control from the angle that the actuator holds. Before the first start, wait while the angle is out of range; if the
 * angle is not available for angle_wait_max samples, the car does not measure it, and control starts from zero. After a silence, control
 * starts from the last measured angle if none arrives within angle_wait_max calls. Returns whether control has started. */
ARS_SECTION_CODE static bool start(ars_task_t *self, bool is_good, bool is_measured)
{
    const float rear_angle = self->conditions.rear_angle;
    bool started = is_measured;

    if (is_measured || (!is_good && !self->has_measured)) {
        /* known, or no good sample yet */
    } else if (!self->has_measured && (magnitude(rear_angle) > self->parameters->inputs.rear_angle_max)) {
        self->samples_without_angle = 0u;
    } else {
        self->samples_without_angle++;
        started = self->samples_without_angle > angle_wait_max;
    }
    if (started) {
        start_from(self, (is_measured || !self->has_measured) ? rear_angle : self->measured_angle);
    }
    return started;
}

/* Return the cause that is known before the step of the controller: feedback cannot be trusted, or the car inhibits it. */
ARS_SECTION_CODE static ars_supervision_cause_t cause_of_loop(const ars_task_t *self, uint32_t diagnostics)
{
    ars_supervision_cause_t cause = ARS_CAUSE_NONE;

    if ((diagnostics & (uint32_t)ARS_DIAGNOSTICS_ACTUATOR_STUCK) != 0u) {
        cause = ARS_CAUSE_ACTUATOR_STUCK;
    } else if ((diagnostics & (uint32_t)ARS_DIAGNOSTICS_TASK_LATE) != 0u) {
        cause = ARS_CAUSE_TASK_LATE;
    } else if (self->conditions_input.supervision.state != ARS_E2E_STATE_VALID) {
        cause = ARS_CAUSE_CONDITIONS_UNKNOWN;
    } else if ((diagnostics & (uint32_t)ARS_DIAGNOSTICS_INTERMITTENT) != 0u) {
        cause = ARS_CAUSE_BUS_INTERMITTENT;
    } else if (self->conditions.inhibit) {
        cause = ARS_CAUSE_INHIBIT;
    } else {
        /* nothing is wrong */
    }
    return cause;
}

/* Return the most urgent cause of a sample. cause: result of cause_of_loop(); status: result of the controller. */
ARS_SECTION_CODE static ars_supervision_cause_t cause_of_sample(
    const ars_task_t *self, ars_supervision_cause_t cause, ars_status_t status, bool has_angle)
{
    ars_supervision_cause_t found = cause;

    if (!has_angle) {
        found = ARS_CAUSE_ANGLE_UNKNOWN;
    } else if (status == ARS_STATUS_FAIL_SAFE) {
        found = ARS_CAUSE_SAMPLE_LOST;
    } else if (status == ARS_STATUS_STANDBY) {
        found = ARS_CAUSE_STANDBY;
    } else if (status == ARS_STATUS_DEGRADED) {
        found = (self->controller.quality == ARS_QUALITY_MISSING) ? ARS_CAUSE_SAMPLE_MISSING : ARS_CAUSE_SIGNAL_REPLACED;
    } else {
        /* the controller follows its reference */
    }
    return found;
}

/* Return whether the car has set Inhibit for longer than a manoeuvre lasts. Only received conditions count. */
ARS_SECTION_CODE static bool is_inhibited_for_good(ars_task_t *self)
{
    if (!self->conditions.inhibit) {
        self->inhibited_samples = 0u;
    } else if (self->conditions_input.usable && (self->inhibited_samples <= self->parameters->inhibit_samples_max)) {
        self->inhibited_samples++;
    } else {
        /* for long enough, or the conditions are not known */
    }
    return self->inhibited_samples > self->parameters->inhibit_samples_max;
}

/* Limit the command for wheels that do not follow: no farther from zero than the last command or the wheels. When the wheels follow
 * again, the command is then close to them. */
ARS_SECTION_CODE static float no_farther_out(float rear_angle, float last, float wheels)
{
    float result = rear_angle;

    if (rear_angle > 0.0f) {
        const float farthest = (wheels > last) ? wheels : last;

        if (rear_angle > farthest) {
            result = (farthest > 0.0f) ? farthest : 0.0f;
        }
    } else {
        const float farthest = (wheels < last) ? wheels : last;

        if (rear_angle < farthest) {
            result = (farthest < 0.0f) ? farthest : 0.0f;
        }
    }
    return result;
}

/* Hold the return to zero while the wheels do not follow it and are farther from zero, for at most wait_samples_max samples. Otherwise
 * the command alone would reach zero, and the actuator would later follow at its full rate. When the wheels move again, the return
 * continues from their angle. last: last command; measured_before: last measured angle. */
ARS_SECTION_CODE static float wait_for_wheels(
    ars_task_t *self, float rear_angle, float last, float measured_before)
{
    const ars_parameters_t *parameters = self->parameters;
    const float wheels = self->conditions.rear_angle - self->angle_offset;
    const bool is_same_side = ((wheels > 0.0f) && (last > 0.0f)) || ((wheels < 0.0f) && (last < 0.0f));
    float result = rear_angle;

    if (is_same_side && is_outer(wheels, rear_angle)) {
        /* An actuator that receives commands covers at least this share of the distance in a sample. */
        const float move_min = parameters->actuator_share * parameters->actuator_error_max;
        const bool has_moved = (magnitude(measured_before - self->angle_offset) - magnitude(wheels)) > move_min;

        self->waited_samples++;
        result = (has_moved && is_outer(self->start_angle, last)) ? bounded(wheels, magnitude(self->start_angle)) : last;
    }
    return result;
}

/* Keep the command near wheels that do not follow it. last: last command; measured_before: last measured angle. */
ARS_SECTION_CODE static void stay_near_wheels(
    ars_task_t *self, ars_command_t *command, float last, float measured_before)
{
    float rear_angle = command->rear_angle;

    if (self->controller.enabled) {
        if (self->deviates || self->is_stuck) {
            rear_angle = no_farther_out(rear_angle, last, self->conditions.rear_angle);
        }
    } else if (self->deviates && (self->waited_samples < wait_samples_max)) {
        rear_angle = wait_for_wheels(self, rear_angle, last, measured_before);
    } else {
        /* the wheels follow, their angle is unknown, or the wait is over */
    }
    if ((rear_angle > command->rear_angle) || (rear_angle < command->rear_angle)) { /* differs */
        ars_controller_place(&self->controller, rear_angle);
        command->rear_angle = self->controller.rear_angle;
    }
}

/* Run the controller and the supervision. Signals of a missing message are passed as not available. The inhibit is held over single lost
 * frames; an impaired loop holds the integrator too. */
ARS_SECTION_CODE static ars_command_t step(
    ars_task_t *self, uint32_t diagnostics, bool is_good, bool is_measured, bool is_waiting)
{
    ars_command_t command;
    float last;
    bool was_controlled;
    bool has_angle = true;
    const bool motion_usable = self->motion_input.usable;
    const bool conditions_usable = self->conditions_input.usable;
    const float not_available = ars_can_not_available();
    const ars_supervision_cause_t cause = cause_of_loop(self, diagnostics);
    const ars_measurement_t measurement = {
        .speed = motion_usable ? self->motion.speed : not_available,
        .front_angle = motion_usable ? self->motion.front_angle : not_available,
        .yaw_rate = motion_usable ? self->motion.yaw_rate : not_available,
        /* The law keeps its demand near the measured angle. Pass only an expected angle, so that a wrong sensor cannot turn the wheels. */
        .rear_angle = (conditions_usable && !self->deviates) ? self->conditions.rear_angle : not_available,
        .friction = conditions_usable ? self->conditions.friction : not_available,
        .lateral_acceleration = conditions_usable ? self->conditions.lateral_acceleration : not_available,
        .inhibit = (((uint32_t)ARS_CAUSES_HOLDING >> (uint32_t)cause) & 1u) != 0u
    };

    if (!is_good) {
        self->lost_samples++;
    }
    if (is_waiting) {
        has_angle = start(self, is_good, is_measured);
    }
    last = self->controller.rear_angle;
    was_controlled = self->controller.enabled;
    if (is_inhibited_for_good(self)) {
        command = ars_controller_stand_by(&self->controller, self->parameters);
    } else if (has_angle || self->has_measured) {
        command = ars_controller_step(&self->controller, self->parameters, &measurement);
    } else {
        command.rear_angle = last; /* before the start; nothing is learned */
        command.yaw_rate_reference = 0.0f;
        command.status = ARS_STATUS_STANDBY;
    }
    self->released = was_controlled && !self->controller.enabled;
    if (self->controller.enabled != was_controlled) {
        self->start_angle = command.rear_angle;
        self->angle_offset = 0.0f;
        self->waited_samples = 0u;
    }
    if (is_measured) {
        stay_near_wheels(self, &command, last, self->measured_angle);
        self->has_measured = true;
        self->measured_angle = self->conditions.rear_angle;
        self->samples_without_angle = 0u;
    }
    command.status = ars_supervision_step(
        &self->supervision, cause_of_sample(self, cause, command.status, has_angle), command.status);
    return command;
}

/* Diagnostics of the controller: replaced signals, and a signal that is not available in a good sample. */
ARS_SECTION_CODE static uint32_t causes_of_controller(const ars_task_t *self, bool is_good)
{
    const ars_inputs_t *inputs = &self->controller.inputs;
    const uint32_t all_replaced = (uint32_t)ARS_DIAGNOSTICS_SPEED_REPLACED
        | (uint32_t)ARS_DIAGNOSTICS_FRONT_ANGLE_REPLACED | (uint32_t)ARS_DIAGNOSTICS_YAW_RATE_REPLACED;
    uint32_t replaced = 0u;
    uint32_t causes = 0u;

    if (is_good && (self->controller.quality == ARS_QUALITY_MISSING)) {
        causes |= (uint32_t)ARS_DIAGNOSTICS_UNAVAILABLE;
    }
    if (inputs->speed.source != ARS_SIGNAL_MEASURED) {
        replaced |= (uint32_t)ARS_DIAGNOSTICS_SPEED_REPLACED;
    }
    if (inputs->front_angle.source != ARS_SIGNAL_MEASURED) {
        replaced |= (uint32_t)ARS_DIAGNOSTICS_FRONT_ANGLE_REPLACED;
    }
    if (inputs->yaw_rate.source != ARS_SIGNAL_MEASURED) {
        replaced |= (uint32_t)ARS_DIAGNOSTICS_YAW_RATE_REPLACED;
    }
    if ((self->controller.status == ARS_STATUS_STANDBY) && (replaced == all_replaced)) {
        replaced = 0u; /* none is judged before the first step */
    }
    return causes | replaced;
}

ARS_SECTION_CODE uint32_t ars_task_10ms(ars_task_t *self, uint8_t data[8])
{
    uint32_t diagnostics;
    ars_rear_steer_command_t signals;
    ars_command_t command;
    bool is_good;
    bool is_measured;
    bool is_waiting;
    bool was_valid;

    start_memory(self);
    keep_command_sound(self);
    is_waiting = lacks_angle(self);
    was_valid = self->conditions_input.supervision.state == ARS_E2E_STATE_VALID;
    diagnostics = check_rhythm(self);
    diagnostics |= check_bus(self);
    diagnostics |= input_close(&self->motion_input);
    diagnostics |= input_close(&self->conditions_input) << conditions_shift;
    self->conditions_close = false;
    is_good = self->motion_input.usable && self->conditions_input.usable;
    is_measured = self->conditions_input.usable && (is_good || self->has_measured)
        && (magnitude(self->conditions.rear_angle) <= self->parameters->inputs.rear_angle_max);
    if (!is_waiting) {
        diagnostics |= check_actuator(self, is_measured, was_valid);
    }
    command = step(self, diagnostics, is_good, is_measured, is_waiting);
    diagnostics |= causes_of_controller(self, is_good);
    /* Before the start, and after a silence, the rear angle is unknown: no command is better than a wrong one. */
    signals.rear_angle = self->supervision.has_command ? command.rear_angle : ars_can_not_available();
    signals.yaw_rate_reference = self->supervision.has_command ? command.yaw_rate_reference : ars_can_not_available();
    signals.status = (uint8_t)command.status;
    signals.diagnostics = (uint16_t)diagnostics;
    ars_can_pack_rear_steer_command(&signals, data);
    ars_e2e_protect((uint16_t)ARS_CAN_DATA_ID_REAR_STEER_COMMAND, &self->counter, data);
    return (uint32_t)ARS_CAN_ID_REAR_STEER_COMMAND;
}
