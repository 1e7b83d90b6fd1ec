/*
 * Yaw-rate controller for active rear steering. See ars_controller.h.
 *
 * Order of a step: check the inputs, find the status, then control, predict or ramp, and finally limit.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_controller.h"

#include "ars_sections.h"

#if ARS_CONTROLLER_BUILD != 0xC9A75925u
#error "ars_controller.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const float sampling_time = 0.01f; /* s */
ARS_SECTION_CONST static const float actuator_angle_max = 0.061086524f; /* rad */

/* Above every sum of squares of a valid state. */
ARS_SECTION_CONST static const float squares_max = 1.0e+12f;

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

/* Return the value moved towards zero by step, which is not negative; 0 for NaN. */
ARS_SECTION_CODE static float toward_zero(float value, float step)
{
    float result = 0.0f;

    if (value > step) {
        result = value - step;
    } else if (value < -step) {
        result = value + step;
    } else {
        /* closer to zero than one step */
    }
    return result;
}

/* Enable control with the first speed. A speed that was never measured, or whose substitute has fallen to zero, does not count. */
ARS_SECTION_CODE static void start_with_speed(ars_controller_t *self)
{
    if ((self->inputs.speed.source == ARS_SIGNAL_MEASURED) || (magnitude(self->sample.speed) > 0.0f)) {
        self->enabled = true;
    } else if (!self->enabled) {
        self->status = ARS_STATUS_STANDBY;
    } else {
        /* control has started */
    }
}

/* m/s. A slower car counts as standing: turning the wheels would scrub the tyres. */
ARS_SECTION_CONST static const float standing_speed = 0.1f;

/* rad/s, rate at low speed: the curvature changes gently when a car starts with turned wheels. */
ARS_SECTION_CONST static const float slow_rate = 0.033161256f;

/* Largest change of the command in a sample at low speed, in rad. It grows with the distance driven, so that the rear of the car does
 * not swing out, and gently. Between slow_speed and three times slow_speed, the rate limit of the law takes over. */
ARS_SECTION_CODE static float slow_step(const ars_parameters_t *parameters, float speed)
{
    const float distance = (magnitude(speed) < standing_speed) ? 0.0f : (magnitude(speed) * sampling_time);
    float step = parameters->fade_rate * distance;

    if (step > (slow_rate * sampling_time)) {
        step = slow_rate * sampling_time;
    }
    if (speed > parameters->slow_speed) {
        const float share = (speed - parameters->slow_speed) / (2.0f * parameters->slow_speed);

        step += (parameters->rear_rate_max * sampling_time) * (share * share); /* begins gently */
    }
    return step;
}

/* Return the value within a step of the last command. */
ARS_SECTION_CODE static float within_step(float value, float last, float step)
{
    float result = value;

    if (value > (last + step)) {
        result = last + step;
    } else if (value < (last - step)) {
        result = last - step;
    } else {
        /* within */
    }
    return result;
}

/* Run the control law for one checked sample. */
ARS_SECTION_CODE static void control(
    ars_controller_t *self, const ars_parameters_t *parameters, ars_law_phase_t phase)
{
    const ars_measurement_t *const sample = &self->sample;
    const float friction = ars_grip_friction(&self->grip, parameters, sample->friction);
    ars_law_output_t output;
    bool is_slowed = false;

    if (self->inputs.yaw_rate.source != ARS_SIGNAL_MEASURED) { /* the sideslip cannot be observed */
        self->law.sideslip = self->law.model.sideslip_angle;
    }
    output = ars_law_step(&self->law, parameters, sample, phase, friction, self->rear_angle, self->yaw_rate_error);
    if (sample->speed < (3.0f * parameters->slow_speed)) {
        const float angle = within_step(output.rear_angle, self->rear_angle, slow_step(parameters, sample->speed));

        is_slowed = (angle > output.rear_angle) || (angle < output.rear_angle);
        self->rear_angle = angle;
    } else {
        self->rear_angle = output.rear_angle;
    }
    self->yaw_rate_reference = output.yaw_rate_reference;
    if (phase != ARS_LAW_PREDICTS) {
        self->yaw_rate_error = output.yaw_rate_reference - sample->yaw_rate;
        if (self->quality == ARS_QUALITY_REPLACED) {
            self->status = ARS_STATUS_DEGRADED;
        } else {
            self->status = (self->law.is_limited || is_slowed) ? ARS_STATUS_LIMITED : ARS_STATUS_TRACKING;
        }
        if (sample->speed <= parameters->slow_speed) { /* the model runs at slow_speed then */
            ars_grip_recover(&self->grip, parameters);
        } else if (!sample->inhibit && (self->quality == ARS_QUALITY_GOOD)) {
            ars_grip_update(&self->grip, parameters, self->law.model.lateral_acceleration, sample->lateral_acceleration);
        } else {
            /* the grip is not learned from such a sample */
        }
    }
}

/* Move the rear angle in a sample without control. In fail-safe it returns to zero at a limited rate: at speed, a sudden return can spin
 * the car, and so can a held angle when the driver steers back. Before the first speed, in standby, it is held. */
ARS_SECTION_CODE static void rest(ars_controller_t *self, const ars_parameters_t *parameters)
{
    self->yaw_rate_reference = 0.0f;
    self->yaw_rate_error = 0.0f;
    if (self->status == ARS_STATUS_FAIL_SAFE) {
        self->rear_angle = toward_zero(self->rear_angle, parameters->fail_safe_rate * sampling_time);
    }
    ars_law_rest(
        &self->law, &self->sample, ars_grip_friction(&self->grip, parameters, self->sample.friction), self->rear_angle);
}

/* Apply the safety limiter. */
ARS_SECTION_CODE static void limit(
    ars_controller_t *self, const ars_parameters_t *parameters)
{
    const ars_limiter_input_t input = { self->sample.speed, self->sample.front_angle, self->rear_angle };
    const float limited_angle = ars_limiter_step(&self->limiter, &parameters->limiter, &input);

    if ((self->status == ARS_STATUS_TRACKING) && ((limited_angle > self->rear_angle) || (limited_angle < self->rear_angle))) {
        self->status = ARS_STATUS_LIMITED;
    }
    self->rear_angle = limited_angle;
}

ARS_SECTION_CODE void ars_controller_place(ars_controller_t *self, float rear_angle)
{
    float held_angle = 0.0f;

    if ((rear_angle > 0.0f) || (rear_angle < 0.0f)) { /* false for NaN */
        held_angle = bounded(rear_angle, actuator_angle_max);
    }
    self->rear_angle = held_angle;
    ars_limiter_init(&self->limiter, held_angle);
}

ARS_SECTION_CODE void ars_controller_init(ars_controller_t *self, float rear_angle)
{
    ars_controller_place(self, rear_angle);
    self->yaw_rate_reference = 0.0f;
    self->yaw_rate_error = 0.0f;
    self->sample.speed = 0.0f;
    self->sample.front_angle = 0.0f;
    self->sample.yaw_rate = 0.0f;
    self->sample.rear_angle = self->rear_angle;
    self->sample.friction = 0.0f;
    self->sample.lateral_acceleration = 0.0f;
    self->sample.inhibit = true;
    self->enabled = false;
    self->quality = ARS_QUALITY_GOOD;
    self->status = ARS_STATUS_STANDBY;
    self->initialised = (uint32_t)ARS_CONTROLLER_INITIALISED;
    ars_inputs_init(&self->inputs, true);
    ars_law_init(&self->law, self->rear_angle);
    ars_grip_init(&self->grip);
}

ARS_SECTION_CODE ars_command_t ars_controller_stand_by(ars_controller_t *self, const ars_parameters_t *parameters)
{
    const float step_max = parameters->limiter.rear_rate_max * sampling_time;
    const float step = parameters->fail_safe_rate * sampling_time;
    ars_command_t command;

    ars_controller_init(self, toward_zero(self->rear_angle, (step < step_max) ? step : step_max));
    command.rear_angle = self->rear_angle;
    command.yaw_rate_reference = self->yaw_rate_reference;
    command.status = self->status;
    return command;
}

/* Return false for a state that was never initialised, or in which a number is NaN, infinite or far too large. */
ARS_SECTION_CODE static bool is_sound(const ars_controller_t *self)
{
    float squares = 0.0f;

    squares += self->law.trim * self->law.trim;
    squares += self->law.sideslip * self->law.sideslip;
    squares += self->law.integral * self->law.integral;
    squares += self->law.front_angle * self->law.front_angle;
    squares += self->law.front_rate * self->law.front_rate;
    squares += self->law.previous_model_yaw_rate * self->law.previous_model_yaw_rate;
    squares += self->law.yaw_rate * self->law.yaw_rate;
    squares += self->rear_angle * self->rear_angle;
    squares += self->yaw_rate_error * self->yaw_rate_error;
    squares += self->law.model.sideslip_angle * self->law.model.sideslip_angle;
    squares += self->law.model.yaw_rate * self->law.model.yaw_rate;
    squares += self->law.model.rear_angle * self->law.model.rear_angle;
    squares += self->law.model.lateral_acceleration * self->law.model.lateral_acceleration;
    squares += self->law.model.front_argument * self->law.model.front_argument;
    squares += self->law.model.rear_argument * self->law.model.rear_argument;
    squares += self->grip.reached * self->grip.reached;
    squares += self->grip.available * self->grip.available;
    squares += self->inputs.speed.value * self->inputs.speed.value;
    squares += self->inputs.front_angle.value * self->inputs.front_angle.value;
    squares += self->inputs.yaw_rate.value * self->inputs.yaw_rate.value;
    squares += self->inputs.expected_yaw_rate * self->inputs.expected_yaw_rate;
    squares += self->inputs.least * self->inputs.least;
    squares += self->inputs.least_of_front * self->inputs.least_of_front;
    squares += self->inputs.yaw_rate_offset * self->inputs.yaw_rate_offset;
    squares += self->inputs.lateral_acceleration_offset * self->inputs.lateral_acceleration_offset;
    squares += self->inputs.lateral_acceleration * self->inputs.lateral_acceleration;
    squares += self->inputs.least_of_lateral * self->inputs.least_of_lateral;
    squares += self->inputs.beyond_linear * self->inputs.beyond_linear;
    squares += self->inputs.friction * self->inputs.friction;
    squares += self->limiter.rear_angle * self->limiter.rear_angle;
    return (self->initialised == (uint32_t)ARS_CONTROLLER_INITIALISED) && (squares <= squares_max); /* false for NaN */
}

/* Return the angle from which unsound state restarts: the measured one; without it the last command, so that the wheels do not jump;
 * without both zero. */
ARS_SECTION_CODE static float restart_angle(
    const ars_controller_t *self, const ars_parameters_t *parameters, float measured)
{
    const float plausible_max = parameters->inputs.rear_angle_max;
    float result = 0.0f;

    if ((measured >= -plausible_max) && (measured <= plausible_max)) { /* false for NaN */
        result = measured;
    } else if ((self->initialised == (uint32_t)ARS_CONTROLLER_INITIALISED) && (self->rear_angle >= -actuator_angle_max)
               && (self->rear_angle <= actuator_angle_max)) {
        result = self->rear_angle;
    } else {
        /* nothing is known */
    }
    return result;
}

ARS_SECTION_CODE ars_command_t ars_controller_step(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement)
{
    ars_law_phase_t phase;
    ars_command_t command;

    if (!is_sound(self)) { /* inputs are used only after enough good samples */
        ars_controller_init(self, restart_angle(self, parameters, measurement->rear_angle));
        ars_inputs_init(&self->inputs, false);
    }
    self->quality = ars_inputs_step(
        &self->inputs, &parameters->inputs, measurement, self->rear_angle, &self->law.model, &self->sample);
    phase = self->enabled ? ARS_LAW_CONTINUES : ARS_LAW_STARTS;
    if (self->quality == ARS_QUALITY_UNUSABLE) {
        self->status = ARS_STATUS_FAIL_SAFE;
        self->enabled = false;
    } else if (self->quality == ARS_QUALITY_MISSING) {
        if (self->enabled) {
            self->status = ARS_STATUS_DEGRADED;
        }
        phase = ARS_LAW_PREDICTS; /* the last measurement replaces the missing one */
    } else {
        start_with_speed(self);
    }
    if (self->enabled) {
        control(self, parameters, phase);
    } else {
        rest(self, parameters);
    }
    limit(self, parameters);
    command.rear_angle = self->rear_angle;
    command.yaw_rate_reference = self->yaw_rate_reference;
    command.status = self->status;
    return command;
}
