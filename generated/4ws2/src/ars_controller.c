/*
 * Yaw-rate controller for active rear steering. See ars_controller.h.
 *
 * Order of a step: what is believed of the sample, the status, then control, predict or ramp; the limiter comes last.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_controller.h"

#include "ars_map.h"
#include "ars_sections.h"

#if ARS_CONTROLLER_BUILD != 0x4CEFD4D1u
#error "ars_controller.h and this source come from different builds"
#endif
#if ARS_MAP_BUILD != 0x4CEFD4D1u
#error "ars_map.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const float sampling_time = 0.01f; /* s */
ARS_SECTION_CONST static const float actuator_angle_max = 0.061086524f; /* rad */

/* Of memory that ars_controller_init() has been at; not zero, which is what memory holds before. */
ARS_SECTION_CONST static const uint32_t initialised = 0x41525331u;

/* The squares of the state's numbers never add up to so much. */
ARS_SECTION_CONST static const float squares_max = 1.0e+12f;

ARS_SECTION_CODE static float clamp(float value, float low, float high)
{
    float result = low;

    if (value > low) {
        result = value;
    }
    if (result > high) {
        result = high;
    }
    return result;
}

/* False for NaN. */
ARS_SECTION_CODE static bool is_between(float value, float low, float high)
{
    return (value >= low) && (value <= high);
}

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

/* What the control law does in a sample. */
typedef enum {
    LAW_STARTS,   /* it did not run before: without a jump of the command */
    LAW_CONTINUES,
    LAW_PREDICTS  /* without a new sample: the model moves on, the last error stays */
} law_phase_t;

/* Control starts at the enabling speed and ends below the disabling one; where it goes on, control() has the last word. */
ARS_SECTION_CODE static void choose_by_speed(ars_controller_t *self, const ars_parameters_t *parameters, float speed)
{
    if (speed >= parameters->enable_speed) {
        self->enabled = true;
    } else if (speed < parameters->disable_speed) {
        self->enabled = false;
    } else {
        /* between the two speeds nothing changes */
    }
    self->status = ARS_STATUS_STANDBY;
}

/* To zero: at speed, taking the rear angle away at once can spin the car, and holding it spins a car whose driver steers back. */
ARS_SECTION_CODE static void fail_safe(ars_controller_t *self, const ars_parameters_t *parameters)
{
    self->rear_angle = toward_zero(self->rear_angle, parameters->fail_safe_rate * sampling_time);
}

/* The estimate, not below the smallest that is believed. */
ARS_SECTION_CODE static float known_friction(const ars_parameters_t *parameters, const ars_measurement_t *measurement)
{
    return (measurement->friction < parameters->friction_min) ? parameters->friction_min : measurement->friction;
}

/* rad that the command may move in a sample. The law goes by the limiter's rate too where that is the lower one: an integral that
 * did not know of it would run away from the command. */
ARS_SECTION_CODE static float command_step(const ars_parameters_t *parameters)
{
    const float own = parameters->rear_rate_max;
    const float behind = parameters->limiter.rear_rate_max;

    return ((own < behind) ? own : behind) * sampling_time;
}

/* Control law "pi": rear_angle = -(Kp error + Ki integral of error). The integral is kept in rad of rear angle, sign included. */
ARS_SECTION_CODE static void law_init(ars_controller_t *self)
{
    self->integral = self->rear_angle;
}

/* What the angle limit and the distance to the actuator let through: one that is stuck or slow must not wind the integral up. */
ARS_SECTION_CODE static float allowed(
    const ars_parameters_t *parameters, const ars_measurement_t *measurement, float demand)
{
    const float ahead = parameters->rear_angle_error_max;
    const float near = clamp(demand, measurement->rear_angle - ahead, measurement->rear_angle + ahead);

    return clamp(near, -parameters->rear_angle_max, parameters->rear_angle_max);
}

/* Returns whether a limit acted. */
ARS_SECTION_CODE static bool law_step(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement, law_phase_t phase)
{
    const float reference
        = ars_map_yaw_rate_on_road(measurement->speed, measurement->front_angle, known_friction(parameters, measurement));
    const float error = reference - measurement->yaw_rate;
    const float proportional = parameters->proportional_gain * error;
    const float step = command_step(parameters);
    /* Bumpless: with this integral the first demand is the angle that is commanded now. */
    const float before = (phase == LAW_STARTS) ? (self->rear_angle + proportional) : self->integral;
    float integral = before;
    float wanted;
    float demand;
    float command;
    bool limited;

    if (!measurement->inhibit) {
        integral -= (parameters->integral_gain * sampling_time) * error;
    }
    wanted = integral - proportional;
    demand = allowed(parameters, measurement, wanted);
    limited = (demand > wanted) || (demand < wanted);
    if (limited && !measurement->inhibit) {
        integral = demand + proportional; /* the integral that gives just the limit: it leaves it in one sample */
    }
    command = clamp(demand, self->rear_angle - step, self->rear_angle + step);
    /* Where the rate limit acts: let the integral not move further ahead of the command. */
    if (demand > command) {
        limited = true;
        integral = (integral > before) ? before : integral;
    } else if (demand < command) {
        limited = true;
        integral = (integral < before) ? before : integral;
    } else {
        /* as it is */
    }
    self->yaw_rate_reference = reference;
    self->integral = integral;
    self->rear_angle = command;
    return limited;
}

ARS_SECTION_CODE static void control(
    ars_controller_t *self, const ars_parameters_t *parameters, law_phase_t phase)
{
    const bool limited = law_step(self, parameters, &self->sample, phase);

    if (self->quality == ARS_QUALITY_REPLACED) {
        self->status = ARS_STATUS_DEGRADED;
    } else {
        self->status = limited ? ARS_STATUS_LIMITED : ARS_STATUS_TRACKING;
    }
    self->yaw_rate_error = self->yaw_rate_reference - self->sample.yaw_rate;
}

/* The last word on the command. */
ARS_SECTION_CODE static void limit(
    ars_controller_t *self, const ars_parameters_t *parameters)
{
    const ars_limiter_input_t input = { self->sample.speed, self->sample.front_angle, self->rear_angle };
    const float limited = ars_limiter_step(&self->limiter, &parameters->limiter, &input);

    if ((self->status == ARS_STATUS_TRACKING) && ((limited > self->rear_angle) || (limited < self->rear_angle))) {
        self->status = ARS_STATUS_LIMITED;
    }
    self->rear_angle = limited;
}

ARS_SECTION_CODE bool ars_parameters_valid(const ars_parameters_t *parameters)
{
    return is_between(parameters->proportional_gain, 0.0f, 10.0f)
        && is_between(parameters->integral_gain, 0.0f, 100.0f)
        && is_between(parameters->rear_angle_error_max, 1.0e-04f, 1.0f)
        && is_between(parameters->rear_angle_max, 1.0e-04f, 0.061086524f)
        && is_between(parameters->rear_rate_max, 1.0e-04f, 1000.0f)
        && is_between(parameters->friction_min, 0.01f, 1.0f)
        && is_between(parameters->enable_speed, 0.01f, 100.0f)
        && is_between(parameters->disable_speed, 0.01f, 100.0f)
        && is_between(parameters->standby_rate, 1.0e-05f, 100.0f)
        && is_between(parameters->fail_safe_rate, 1.0e-05f, 100.0f)
        && is_between(parameters->actuator_share, 1.0e-04f, 1.0f)
        && is_between(parameters->actuator_error_max, 1.0e-04f, 1.5f)
        && (parameters->rear_angle_max <= parameters->inputs.rear_angle_max)
        && (parameters->disable_speed < parameters->enable_speed)
        && (parameters->enable_speed <= parameters->inputs.speed_max)
        && (parameters->friction_min <= parameters->inputs.friction_max)
        && (parameters->inputs.speed_max <= parameters->limiter.speed_max)
        && (parameters->inputs.front_angle_max <= parameters->limiter.front_angle_max)
        && (parameters->actuator_samples_max >= 1u)
        && (parameters->actuator_samples_max <= 60000u)
        && (parameters->limiter.rear_angle_max <= parameters->rear_angle_max)
        && ars_inputs_parameters_valid(&parameters->inputs)
        && ars_limiter_parameters_valid(&parameters->limiter)
        && ars_map_valid();
}

ARS_SECTION_CODE void ars_controller_init(ars_controller_t *self, float rear_angle)
{
    float start = 0.0f;

    if ((rear_angle > 0.0f) || (rear_angle < 0.0f)) { /* false for NaN */
        start = clamp(rear_angle, -actuator_angle_max, actuator_angle_max);
    }
    self->rear_angle = start;
    self->yaw_rate_reference = 0.0f;
    self->yaw_rate_error = 0.0f;
    self->sample.speed = 0.0f;
    self->sample.front_angle = 0.0f;
    self->sample.yaw_rate = 0.0f;
    self->sample.rear_angle = start;
    self->sample.friction = 0.0f;
    self->sample.lateral_acceleration = 0.0f;
    self->sample.inhibit = true;
    self->enabled = false;
    self->quality = ARS_QUALITY_GOOD;
    self->status = ARS_STATUS_STANDBY;
    self->initialised = initialised;
    ars_inputs_init(&self->inputs, true);
    ars_limiter_init(&self->limiter, start);
    law_init(self);
}

/* False for memory that was never initialised, and where a number of the state is none. */
ARS_SECTION_CODE static bool is_sound(const ars_controller_t *self)
{
    float squares = 0.0f;

    squares += self->integral * self->integral;
    squares += self->rear_angle * self->rear_angle;
    squares += self->yaw_rate_reference * self->yaw_rate_reference;
    squares += self->yaw_rate_error * self->yaw_rate_error;
    squares += self->inputs.speed.value * self->inputs.speed.value;
    squares += self->inputs.front_angle.value * self->inputs.front_angle.value;
    squares += self->inputs.yaw_rate.value * self->inputs.yaw_rate.value;
    squares += self->inputs.expected_yaw_rate * self->inputs.expected_yaw_rate;
    squares += self->inputs.least * self->inputs.least;
    squares += self->inputs.least_of_front * self->inputs.least_of_front;
    squares += self->inputs.yaw_rate_offset * self->inputs.yaw_rate_offset;
    squares += self->inputs.friction * self->inputs.friction;
    squares += self->limiter.rear_angle * self->limiter.rear_angle;
    squares += self->limiter.speed * self->limiter.speed;
    squares += self->limiter.front_angle * self->limiter.front_angle;
    return (self->initialised == initialised) && (squares <= squares_max); /* false for NaN */
}

ARS_SECTION_CODE ars_command_t ars_controller_step(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement)
{
    ars_command_t command;

    if (!is_sound(self)) { /* afresh, from where the rear wheels stand, and not before good samples */
        ars_controller_init(self, measurement->rear_angle);
        ars_inputs_init(&self->inputs, false);
    }
    self->quality = ars_inputs_step(&self->inputs, &parameters->inputs, measurement, self->rear_angle, &self->sample);
    if (self->quality == ARS_QUALITY_UNUSABLE) {
        self->status = ARS_STATUS_FAIL_SAFE;
        self->enabled = false;
    } else if (self->quality == ARS_QUALITY_MISSING) {
        if (self->status != ARS_STATUS_FAIL_SAFE) {
            self->status = ARS_STATUS_DEGRADED;
        }
        if (self->sample.speed < parameters->disable_speed) {
            self->enabled = false;
        }
        if (self->enabled) { /* what was measured last stands for what is missing */
            (void)law_step(self, parameters, &self->sample, LAW_PREDICTS);
        }
    } else {
        const law_phase_t phase = self->enabled ? LAW_CONTINUES : LAW_STARTS;

        choose_by_speed(self, parameters, self->sample.speed);
        if (self->enabled) {
            control(self, parameters, phase);
        }
    }
    if (self->status == ARS_STATUS_STANDBY) {
        self->rear_angle = toward_zero(self->rear_angle, parameters->standby_rate * sampling_time);
    }
    if (self->status == ARS_STATUS_FAIL_SAFE) {
        fail_safe(self, parameters);
    }
    if (!self->enabled) {
        self->yaw_rate_reference = 0.0f;
        self->yaw_rate_error = 0.0f;
    }
    limit(self, parameters);
    command.rear_angle = self->rear_angle;
    command.yaw_rate_reference = self->yaw_rate_reference;
    command.status = self->status;
    return command;
}
