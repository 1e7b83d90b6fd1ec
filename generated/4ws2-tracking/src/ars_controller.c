/*
 * Yaw-rate controller for active rear steering. See ars_controller.h.
 *
 * Order of a step: what is believed of the sample, the status, then control, predict or ramp; the limiter comes last.
 *
 * Map 4ws2-tracking: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_controller.h"

#include "ars_map.h"
#include "ars_sections.h"

#if ARS_CONTROLLER_BUILD != 0xA341B9E4u
#error "ars_controller.h and this source come from different builds"
#endif
#if ARS_MAP_BUILD != 0xA341B9E4u
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

/* Control law "tracking": rear_angle = feedforward - (Kp error + Ki integral of error). The feedforward is the map's own rear
 * angle, a little ahead of the front wheels; the error is taken to what the car can do with it, by the reference model. The
 * integral is kept in rad of rear angle, sign included. */
ARS_SECTION_CONST static const float grip_max = 5.611226f; /* m/s^2: what the map allows on its road */
ARS_SECTION_CONST static const float friction_per_grip = 0.16039282f; /* s^2/m */

/* A model follows its map a little above what the road is taken to allow: the margin of its transients. */
ARS_SECTION_CONST static const float reference_overshoot = 1.15f;

typedef struct {
    float proportional;
    float integral;
    float lead_time;
    float response;
} gains_t;

/* Where demand and feedback may move. */
typedef struct {
    float low;
    float high;
} range_t;

ARS_SECTION_CODE static float magnitude(float value)
{
    return (value < 0.0f) ? -value : value;
}

ARS_SECTION_CODE static float interpolated(const float values[], uint32_t lower, float share)
{
    return values[lower] + (share * (values[lower + 1u] - values[lower]));
}

/* Between the breakpoints linear, beyond them held. */
ARS_SECTION_CODE static gains_t gains_at(const ars_parameters_t *parameters, float speed)
{
    const float *const at = parameters->schedule_speed;
    uint32_t lower = 0u;
    uint32_t upper = (uint32_t)ARS_SCHEDULE_POINTS - 1u;
    uint32_t k;
    float share;
    gains_t gains;

    for (k = 0u; k < 4u; k++) {
        const uint32_t middle = (lower + upper) / 2u;

        if (speed >= at[middle]) {
            lower = middle;
        } else {
            upper = middle;
        }
    }
    share = clamp((speed - at[lower]) / (at[lower + 1u] - at[lower]), 0.0f, 1.0f);
    gains.proportional = interpolated(parameters->proportional_gain, lower, share);
    gains.integral = interpolated(parameters->integral_gain, lower, share);
    gains.lead_time = interpolated(parameters->lead_time, lower, share);
    gains.response = interpolated(parameters->response_gain, lower, share);
    return gains;
}

ARS_SECTION_CODE static void law_init(ars_controller_t *self)
{
    ars_reference_model_start(&self->model, 0.0f, 0.0f, self->rear_angle);
    self->trim = 0.0f;
    self->integral = 0.0f;
    self->front_angle = 0.0f;
    self->front_rate = 0.0f;
    self->missed_samples = 0u;
    self->yaw_rate = 0.0f;
    self->reached = 0.0f;
    self->grip = grip_max;
}

/* The road's friction: estimated, or what the car has been seen to reach, whichever is less. */
ARS_SECTION_CODE static float friction_now(
    const ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement)
{
    const float estimated = known_friction(parameters, measurement);
    const float seen = self->grip * friction_per_grip;

    return (estimated < seen) ? estimated : seen;
}

/* The map a little ahead of the front wheels, by their rate, which is smoothed: a difference of two samples is mostly noise.
 * Its rear angle is that of the steady turn. On the way there it steers against what the model still lacks in yaw rate. */
ARS_SECTION_CODE static ars_map_reference_t reference_ahead(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement, const gains_t *gains,
    float friction, law_phase_t phase)
{
    ars_map_reference_t reference;
    float lead;

    if (phase == LAW_PREDICTS) {
        self->missed_samples++;
    } else {
        const float age = sampling_time * ((float)self->missed_samples + 1.0f);
        const float rate = (measurement->front_angle - self->front_angle) / age;

        self->front_angle = measurement->front_angle;
        self->front_rate += parameters->lead_smoothing * (rate - self->front_rate);
        self->missed_samples = 0u;
    }
    lead = clamp(gains->lead_time * self->front_rate, -parameters->lead_angle_max, parameters->lead_angle_max);
    reference = ars_map_reference(measurement->speed, measurement->front_angle + lead, friction);
    reference.rear_angle -= gains->response * (reference.yaw_rate - self->model.yaw_rate);
    reference.rear_angle = clamp(reference.rear_angle, -parameters->rear_angle_max, parameters->rear_angle_max);
    return reference;
}

/* Bumpless: the model starts from the measured motion. */
ARS_SECTION_CODE static void start_law(ars_controller_t *self, const ars_measurement_t *measurement)
{
    self->front_angle = measurement->front_angle;
    self->front_rate = 0.0f;
    self->yaw_rate = measurement->yaw_rate;
    self->trim = 0.0f;
    ars_reference_model_start(&self->model, measurement->speed, measurement->yaw_rate, self->rear_angle);
}

/* The yaw rate that the car can have now: the model's, drawn slowly towards the map's by a bounded trim. */
ARS_SECTION_CODE static float reachable_yaw_rate(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_map_reference_t *map, float speed)
{
    const float bound = parameters->trim_share * magnitude(map->yaw_rate);
    const float missing = clamp(map->yaw_rate - self->model.yaw_rate, -bound, bound);
    const float limit = reference_overshoot * (map->lateral_acceleration_max / speed);

    self->trim += (parameters->trim_rate * sampling_time) * (missing - self->trim);
    return clamp(self->model.yaw_rate + self->trim, -limit, limit);
}

/* Feedback may add a little where it makes the car turn more; against the turn it is free. Which way it turns is asked of two
 * samples, so that one wrong sign opens neither side. */
ARS_SECTION_CODE static range_t feedback_range(
    const ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement, float feedforward)
{
    const bool turns_left = (measurement->yaw_rate > 0.0f) || (self->yaw_rate > 0.0f);
    const bool turns_right = (measurement->yaw_rate < 0.0f) || (self->yaw_rate < 0.0f);
    range_t range = { -parameters->rear_angle_max, parameters->rear_angle_max };

    /* The demand may run ahead of the actuator by so much and no more: one that is stuck or slow must not wind the integral up. */
    range.low = clamp(measurement->rear_angle - parameters->rear_angle_error_max, range.low, range.high);
    range.high = clamp(measurement->rear_angle + parameters->rear_angle_error_max, range.low, range.high);
    if (turns_left) {
        range.low = clamp(feedforward - parameters->yaw_increasing_max, range.low, range.high);
    }
    if (turns_right) {
        range.high = clamp(feedforward + parameters->yaw_increasing_max, range.low, range.high);
    }
    range.low -= feedforward;
    range.high -= feedforward;
    return range;
}

/* The grip follows the lateral acceleration that the car really reaches: down where much of it is missing in the turn that is
 * asked for, but never below what was reached lately; slowly up again. */
ARS_SECTION_CODE static void update_grip(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement)
{
    const bool leftwards = self->yaw_rate_reference > 0.0f;
    const float asked = (leftwards ? self->yaw_rate_reference : -self->yaw_rate_reference) * measurement->speed;
    const float turning = (leftwards ? measurement->yaw_rate : -measurement->yaw_rate) * measurement->speed;
    const float reached = magnitude(turning);
    const float shortfall = asked - turning;
    const float remembered = self->reached - ((parameters->grip_forgetting * sampling_time) * self->reached);
    /* A turn that asks for little says nothing of the road: what was found out in the last one is then forgotten sooner. */
    const float recovery = (asked < (0.5f * self->grip)) ? parameters->grip_recovery_idle : parameters->grip_recovery;
    float grip = self->grip + (recovery * sampling_time);

    self->reached = (reached > remembered) ? reached : remembered;
    if ((turning > 0.0f) && (shortfall > parameters->grip_shortfall)) { /* one that comes from another turn does not slip */
        grip = self->grip - ((parameters->grip_loss_rate * sampling_time) * (shortfall - parameters->grip_shortfall));
    }
    if (grip < self->reached) {
        grip = self->reached;
    }
    self->grip = clamp(grip, parameters->friction_min / friction_per_grip, grip_max);
}

/* In standby nothing is learned of the road, and what is known of it grows old. It survives the fail-safe. */
ARS_SECTION_CODE static void let_grip_recover(ars_controller_t *self, const ars_parameters_t *parameters)
{
    const float grip = self->grip + (parameters->grip_recovery_idle * sampling_time);

    self->reached -= (parameters->grip_forgetting * sampling_time) * self->reached;
    self->grip = (grip < grip_max) ? grip : grip_max;
}

/* One sample of the law. */
ARS_SECTION_CODE static bool track(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement, law_phase_t phase)
{
    const float friction = friction_now(self, parameters, measurement);
    const gains_t gains = gains_at(parameters, measurement->speed);
    const ars_map_reference_t map = reference_ahead(self, parameters, measurement, &gains, friction, phase);
    const ars_reference_model_input_t input = { measurement->speed, measurement->front_angle, map.rear_angle, friction };
    const float reference = reachable_yaw_rate(self, parameters, &map, measurement->speed);
    /* Between two good samples the error is the last one: the model moves on, and the car is taken to move with it. */
    const float error = (phase == LAW_PREDICTS) ? self->yaw_rate_error : (reference - measurement->yaw_rate);
    const range_t range = feedback_range(self, parameters, measurement, map.rear_angle);
    const float proportional = gains.proportional * error;
    const float step = command_step(parameters);
    float integral;
    float feedback;
    float demand;
    float command;
    bool limited;

    if (phase == LAW_STARTS) {
        self->integral = self->rear_angle - map.rear_angle; /* the first demand is the angle that is commanded now */
    }
    integral = self->integral;
    if (!measurement->inhibit) {
        integral -= (gains.integral * sampling_time) * error;
    }
    feedback = integral - proportional;
    limited = (feedback > range.high) || (feedback < range.low);
    if (limited && !measurement->inhibit) {
        /* The integral stays, held within the limit: where its step would lead back, it starts so far outside that it ends at
         * the limit too. What is proportional to one sample's error is not kept. */
        integral = clamp(self->integral, range.low, range.high);
    }
    feedback = clamp(feedback, range.low, range.high);

    demand = map.rear_angle + feedback;
    command = clamp(demand, self->rear_angle - step, self->rear_angle + step);
    /* Where the rate limit acts: let the integral not move further ahead of the command. */
    if (demand > command) {
        limited = true;
        integral = (integral > self->integral) ? self->integral : integral;
    } else if (demand < command) {
        limited = true;
        integral = (integral < self->integral) ? self->integral : integral;
    } else {
        /* as it is */
    }
    self->integral = integral;
    self->rear_angle = command;
    self->yaw_rate_reference = reference;
    if (!measurement->inhibit && (self->quality == ARS_QUALITY_GOOD)) {
        update_grip(self, parameters, measurement);
    }
    self->yaw_rate = measurement->yaw_rate;
    ars_reference_model_step(&self->model, &input);
    return limited;
}

/* Returns whether a limit acted. */
ARS_SECTION_CODE static bool law_step(
    ars_controller_t *self, const ars_parameters_t *parameters, const ars_measurement_t *measurement, law_phase_t phase)
{
    if (phase == LAW_STARTS) {
        start_law(self, measurement);
    }
    return track(self, parameters, measurement, phase);
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

ARS_SECTION_CODE static bool are_valid_arrays(const ars_parameters_t *parameters)
{
    bool valid = true;
    uint32_t k;

    for (k = 0u; k < (uint32_t)ARS_SCHEDULE_POINTS; k++) {
        valid = valid && is_between(parameters->schedule_speed[k], 0.0f, 200.0f);
        valid = valid && ((k == 0u) || (parameters->schedule_speed[k - 1u] < parameters->schedule_speed[k]));
        valid = valid && is_between(parameters->proportional_gain[k], 0.0f, 10.0f);
        valid = valid && is_between(parameters->integral_gain[k], 0.0f, 100.0f);
        valid = valid && is_between(parameters->lead_time[k], -0.2f, 0.2f);
        valid = valid && is_between(parameters->response_gain[k], 0.0f, 2.0f);
    }
    return valid;
}

ARS_SECTION_CODE bool ars_parameters_valid(const ars_parameters_t *parameters)
{
    return is_between(parameters->lead_smoothing, 0.01f, 1.0f)
        && is_between(parameters->lead_angle_max, 0.0f, 0.5f)
        && is_between(parameters->yaw_increasing_max, 0.0f, 1.0f)
        && is_between(parameters->trim_share, 0.0f, 0.2f)
        && is_between(parameters->trim_rate, 0.01f, 20.0f)
        && is_between(parameters->grip_shortfall, 0.1f, 20.0f)
        && is_between(parameters->grip_loss_rate, 0.1f, 50.0f)
        && is_between(parameters->grip_forgetting, 0.01f, 50.0f)
        && is_between(parameters->grip_recovery, 0.01f, 100.0f)
        && is_between(parameters->grip_recovery_idle, 0.01f, 100.0f)
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
        && are_valid_arrays(parameters)
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

    squares += self->trim * self->trim;
    squares += self->integral * self->integral;
    squares += self->front_angle * self->front_angle;
    squares += self->front_rate * self->front_rate;
    squares += self->yaw_rate * self->yaw_rate;
    squares += self->reached * self->reached;
    squares += self->grip * self->grip;
    squares += self->rear_angle * self->rear_angle;
    squares += self->yaw_rate_reference * self->yaw_rate_reference;
    squares += self->yaw_rate_error * self->yaw_rate_error;
    squares += self->model.sideslip_angle * self->model.sideslip_angle;
    squares += self->model.yaw_rate * self->model.yaw_rate;
    squares += self->model.rear_angle * self->model.rear_angle;
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
        let_grip_recover(self, parameters);
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
