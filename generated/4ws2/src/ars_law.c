/*
 * Control law, kind "tracking". See ars_law.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_law.h"

#include "ars_constants.h"
#include "ars_map.h"
#include "ars_sections.h"

#if ARS_CONSTANTS_BUILD != 0xC9A75925u
#error "ars_constants.h and this source come from different builds"
#endif
#if ARS_LAW_BUILD != 0xC9A75925u
#error "ars_law.h and this source come from different builds"
#endif
#if ARS_MAP_BUILD != 0xC9A75925u
#error "ars_map.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const float sampling_time = 0.01f; /* s */

/* Return the value within low and high; low for NaN. */
ARS_SECTION_CODE static float clamp(float value, float low, float high)
{
    float result = low; /* NaN too */

    if (value > high) {
        result = high;
    } else if (value >= low) {
        result = value;
    } else {
        /* below, or NaN */
    }
    return result;
}

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

/* Largest change of the command in a sample, in rad. It includes the rate of the safety limiter: otherwise the integral would run away
 * from the command where that is the lower one. */
ARS_SECTION_CODE static float command_step(const ars_parameters_t *parameters)
{
    const float law_rate_max = parameters->rear_rate_max;
    const float limiter_rate_max = parameters->limiter.rear_rate_max;

    return ((law_rate_max < limiter_rate_max) ? law_rate_max : limiter_rate_max) * sampling_time;
}

/* Control law "tracking": rear_angle = feedforward - (Kp error + Ki integral of error). The feedforward is the rear angle of the map
 * with lead on the front angle. The error is the difference to the yaw rate that the reference model reaches with it. The integral
 * is stored as a rear angle in rad, with its sign. Feedback fades in between slow_speed and twice slow_speed; slower and in reverse
 * the rear angle is that of the map. */

/* Rate in 1/s at which the observed sideslip returns to that of the model: it forgets what an offset of the acceleration integrates to. */
ARS_SECTION_CONST static const float sideslip_return = 0.4f;

/* The lead of the reference over the acceleration falls by so many times the share of sideslip_max: to none at a third of it. */
ARS_SECTION_CONST static const float lead_loss = 3.0f;

/* Yaw rate for each rad of sideslip beyond sideslip_max, in 1/s, by which the reference falls. */
ARS_SECTION_CONST static const float sideslip_gain = 2.0f;

ARS_SECTION_CONST static const float sideslip_bound = 0.34906584f; /* rad */

/* Factor by which the reference may exceed the lateral acceleration that the road allows, for transients of the model. */
ARS_SECTION_CONST static const float reference_overshoot = 1.15f;

typedef struct {
    float proportional;
    float integral;
    float lead_time;
    float response;
} gains_t;

/* Range of the demand or of the feedback, in rad. */
typedef struct {
    float low;
    float high;
} range_t;

/* Yaw rate of a car with these steering angles: in reverse it turns to the other side. */
ARS_SECTION_CODE static float in_direction(float yaw_rate, float speed)
{
    return (speed < 0.0f) ? -yaw_rate : yaw_rate;
}

/* Share of the feedback at a speed. */
ARS_SECTION_CODE static float feedback_share(const ars_parameters_t *parameters, float speed)
{
    return clamp((speed - parameters->slow_speed) / parameters->slow_speed, 0.0f, 1.0f);
}

/* Speed of the model, at least slow_speed. */
ARS_SECTION_CODE static float model_speed(const ars_parameters_t *parameters, float speed)
{
    return (speed > parameters->slow_speed) ? speed : parameters->slow_speed;
}

ARS_SECTION_CODE static float interpolated(const float values[], uint32_t lower, float fraction)
{
    return values[lower] + (fraction * (values[lower + 1u] - values[lower]));
}

/* Gains at a speed: linear between the breakpoints, constant beyond them. */
ARS_SECTION_CODE static gains_t gains_at(const ars_parameters_t *parameters, float speed)
{
    const float *const breakpoints = parameters->schedule_speed;
    uint32_t lower = 0u;
    float fraction;
    gains_t gains;

    /* Binary search without a loop: each stride halves the remaining cells. */
    if (speed >= breakpoints[lower + 3u]) {
        lower += 3u;
    }
    if (speed >= breakpoints[lower + 2u]) {
        lower += 2u;
    }
    if (speed >= breakpoints[lower + 1u]) {
        lower += 1u;
    }
    fraction = clamp((speed - breakpoints[lower]) / (breakpoints[lower + 1u] - breakpoints[lower]), 0.0f, 1.0f);
    gains.proportional = interpolated(parameters->proportional_gain, lower, fraction);
    gains.integral = interpolated(parameters->integral_gain, lower, fraction);
    gains.lead_time = interpolated(parameters->lead_time, lower, fraction);
    gains.response = interpolated(parameters->response_gain, lower, fraction);
    return gains;
}

ARS_SECTION_CODE void ars_law_init(ars_law_t *self, float rear_angle)
{
    (void)rear_angle; /* the model starts straight ahead: the first sample under control starts it anew from the motion of the car */
    self->model.sideslip_angle = 0.0f;
    self->model.yaw_rate = 0.0f;
    self->model.rear_angle = 0.0f;
    self->model.lateral_acceleration = 0.0f;
    self->model.front_argument = 0.0f;
    self->model.rear_argument = 0.0f;
    self->trim = 0.0f;
    self->sideslip = 0.0f;
    self->integral = 0.0f;
    self->front_angle = 0.0f;
    self->front_rate = 0.0f;
    self->missed_samples = 0u;
    self->yaw_rate = 0.0f;
    self->is_limited = false;
    self->previous_model_yaw_rate = 0.0f;
}

/* Look up the map with lead: the front angle is extrapolated by its rate, which is smoothed because the difference of two samples is
 * mostly noise. The map's rear angle is that of the steady turn. In transients it is corrected for the yaw rate that the model
 * will still be short of when the actuator has responded. */
ARS_SECTION_CODE static ars_map_reference_t reference_ahead(
    ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, const gains_t *gains,
    float fade, float friction, ars_law_phase_t phase)
{
    ars_map_reference_t reference;
    float lead;
    float expected_yaw_rate;

    if (phase == ARS_LAW_PREDICTS) {
        self->missed_samples++;
    } else {
        const float age = (self->missed_samples > 0u) ? (sampling_time * ((float)self->missed_samples + 1.0f)) : sampling_time;
        const float rate = (sample->front_angle - self->front_angle) / age;

        self->front_angle = sample->front_angle;
        self->front_rate += parameters->lead_smoothing * (rate - self->front_rate);
        self->missed_samples = 0u;
    }
    lead = bounded(gains->lead_time * self->front_rate, parameters->lead_angle_max);
    reference = ars_map_reference(magnitude(sample->speed), sample->front_angle + lead, friction);
    expected_yaw_rate = self->model.yaw_rate
        + (parameters->response_samples * (self->model.yaw_rate - self->previous_model_yaw_rate));
    reference.rear_angle -= (fade * gains->response) * (reference.yaw_rate - expected_yaw_rate);
    reference.rear_angle = bounded(reference.rear_angle, parameters->rear_angle_max);
    return reference;
}

/* Start the model from the measured motion, so that the command does not jump. */
ARS_SECTION_CODE static void start_law(
    ars_law_t *self, const ars_measurement_t *sample, float speed, float rear_angle)
{
    self->front_angle = sample->front_angle;
    self->front_rate = 0.0f;
    self->yaw_rate = sample->yaw_rate;
    self->trim = 0.0f;
    ars_reference_model_start(&self->model, speed, sample->yaw_rate, rear_angle);
    self->previous_model_yaw_rate = self->model.yaw_rate;
    self->sideslip = self->model.sideslip_angle;
}

/* Observe the sideslip: integrate the measured motion, and return slowly to the sideslip of the model. */
ARS_SECTION_CODE static void observe_sideslip(ars_law_t *self, const ars_measurement_t *sample, float slowness)
{
    const float rate = ((sample->lateral_acceleration * slowness) - sample->yaw_rate)
        + (sideslip_return * (self->model.sideslip_angle - self->sideslip));

    self->sideslip = bounded(self->sideslip + (sampling_time * rate), sideslip_bound);
}

/* Return the value, or 0 for a negative one. */
ARS_SECTION_CODE static float not_negative(float value)
{
    return (value > 0.0f) ? value : 0.0f;
}

/* Yaw rate that the car can reach now: that of the model plus a bounded trim, which moves slowly towards the map. It exceeds
 * lateral acceleration / speed by no more than in the model, plus a margin: where the tyres give no more force, a higher yaw rate only
 * adds sideslip. speed: result of model_speed(). outward: sideslip out of the turn, as a share of sideslip_max; 0 for sideslip into the
 * turn. share: 1 - outward. */
ARS_SECTION_CODE static float reachable_yaw_rate(
    ars_law_t *self, const ars_parameters_t *parameters, const ars_map_reference_t *map,
    const ars_measurement_t *sample, float speed, float slowness, float outward, float share)
{
    const float trim_max = parameters->trim_share * magnitude(map->yaw_rate);
    const float trim_demand = bounded(map->yaw_rate - self->model.yaw_rate, trim_max);
    const float lead = magnitude((self->model.yaw_rate * speed) - self->model.lateral_acceleration);
    const float lead_share = not_negative(1.0f - (lead_loss * outward));
    const float margin = parameters->turn_margin_rate * speed;
    const float turn_max = (magnitude(sample->lateral_acceleration) + (lead_share * lead))
        + ((margin > parameters->turn_margin) ? margin : parameters->turn_margin);
    const float road_max = reference_overshoot * map->lateral_acceleration_max;
    float yaw_rate_max = slowness * ((road_max < turn_max) ? road_max : turn_max);

    if (share < 0.0f) {
        const float reduced_yaw_rate = yaw_rate_max + ((sideslip_gain * parameters->sideslip_max) * share);

        yaw_rate_max = not_negative(reduced_yaw_rate);
    }

    self->trim += (parameters->trim_rate * sampling_time) * (trim_demand - self->trim);
    return bounded(self->model.yaw_rate + self->trim, yaw_rate_max);
}

/* Range of the feedback. It may increase the turn by yaw_increasing_wide; sideslip out of the turn reduces this down to
 * yaw_increasing_max. Against the turn it is free up to the slip angle at which the rear tyres have their peak force: beyond it they
 * would lose force. The direction of the turn is taken from two samples, so that a single wrong sign releases neither side. */
ARS_SECTION_CODE static range_t feedback_range(
    const ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, float feedforward,
    float rear_slip_max, float slowness, float share)
{
    const float straight_rear_slip = self->sideslip - (ars_constants.rear_arm * (sample->yaw_rate * slowness));
    const float increasing_max
        = parameters->yaw_increasing_max + (not_negative(share) * (parameters->yaw_increasing_wide - parameters->yaw_increasing_max));
    /* Limit the distance between demand and measured angle: a stuck or slow actuator must not wind up the integral. */
    range_t range = {
        bounded(sample->rear_angle - parameters->rear_angle_error_max, parameters->rear_angle_max),
        bounded(sample->rear_angle + parameters->rear_angle_error_max, parameters->rear_angle_max)
    };

    if ((sample->yaw_rate > 0.0f) || (self->yaw_rate > 0.0f)) {
        range.low = clamp(feedforward - increasing_max, range.low, range.high);
    }
    if ((sample->yaw_rate < 0.0f) || (self->yaw_rate < 0.0f)) {
        range.high = clamp(feedforward + increasing_max, range.low, range.high);
    }
    range.high = clamp(straight_rear_slip + rear_slip_max, range.low, range.high);
    range.low = clamp(straight_rear_slip - rear_slip_max, range.low, range.high);
    range.low -= feedforward;
    range.high -= feedforward;
    return range;
}

/* Compute one sample of the running law. */
ARS_SECTION_CODE static ars_law_output_t track(
    ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase,
    float friction, float rear_angle, float yaw_rate_error)
{
    const float speed = model_speed(parameters, sample->speed);
    const float slowness = 1.0f / speed;
    const float fade = feedback_share(parameters, sample->speed);
    const gains_t gains = gains_at(parameters, speed);
    const ars_map_reference_t map = reference_ahead(self, parameters, sample, &gains, fade, friction, phase);
    const ars_reference_model_input_t input = { speed, sample->front_angle, map.rear_angle, friction };
    /* On a slippery road the peak force is at the same slip, or at one in proportion to the friction, depending on the tyre: take the mean. */
    const float rear_slip_max = ars_constants.rear_slip_least + (friction * ars_constants.rear_slip_per_friction);
    const float command_step_max = command_step(parameters);
    float outward;
    float share;
    float reference;
    float error;
    float proportional;
    range_t range;
    float integral;
    float feedback;
    float rear_angle_demand;
    ars_law_output_t output;
    bool limited = false;

    observe_sideslip(self, sample, slowness);
    outward = not_negative((self->model.yaw_rate > 0.0f) ? -self->sideslip : self->sideslip) / parameters->sideslip_max;
    share = 1.0f - outward;
    reference = reachable_yaw_rate(self, parameters, &map, sample, speed, slowness, outward, share);
    /* Without a new sample the last error is kept: the car is assumed to move with the model. */
    error = (phase == ARS_LAW_PREDICTS) ? yaw_rate_error : (reference - sample->yaw_rate);
    proportional = gains.proportional * error;
    range = feedback_range(self, parameters, sample, map.rear_angle, rear_slip_max, slowness, share);
    output.yaw_rate_reference = (fade > 0.0f) ? reference : in_direction(map.yaw_rate, sample->speed);
    if (phase == ARS_LAW_STARTS) {
        self->integral = rear_angle - map.rear_angle; /* bumpless: the first demand is the present command */
    }
    integral = self->integral;
    if (!sample->inhibit) {
        integral -= (gains.integral * sampling_time) * error;
    }
    feedback = integral - proportional;
    if (feedback > range.high) {
        feedback = range.high;
        limited = fade > 0.0f;
    } else if (feedback < range.low) {
        feedback = range.low;
        limited = fade > 0.0f;
    } else {
        /* within the range */
    }
    if (limited && !sample->inhibit) {
        /* Keep the integral within the range, without the step of this sample: the feedback is so far outside the range that even a
         * step towards it would end at the limit. The proportional part is not stored. */
        integral = clamp(self->integral, range.low, range.high);
    }

    rear_angle_demand = map.rear_angle + (fade * feedback);
    /* Anti-windup: at the rate limit the integral must not move further ahead of the command. */
    if (rear_angle_demand > (rear_angle + command_step_max)) {
        output.rear_angle = rear_angle + command_step_max;
        limited = true;
        integral = (integral > self->integral) ? self->integral : integral;
    } else if (rear_angle_demand < (rear_angle - command_step_max)) {
        output.rear_angle = rear_angle - command_step_max;
        limited = true;
        integral = (integral < self->integral) ? self->integral : integral;
    } else {
        output.rear_angle = rear_angle_demand;
    }
    if (fade > 0.0f) {
        self->integral = integral;
    } else { /* the feedback starts without memory when it returns */
        self->integral = 0.0f;
        self->sideslip = self->model.sideslip_angle;
    }
    self->yaw_rate = sample->yaw_rate;
    self->is_limited = limited;
    self->previous_model_yaw_rate = self->model.yaw_rate;
    ars_reference_model_step(&self->model, &input);
    return output;
}

ARS_SECTION_CODE ars_law_output_t ars_law_step(
    ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase,
    float friction, float rear_angle, float yaw_rate_error)
{
    if (phase == ARS_LAW_STARTS) {
        start_law(self, sample, model_speed(parameters, sample->speed), rear_angle);
    }
    return track(self, parameters, sample, phase, friction, rear_angle, yaw_rate_error);
}

/* The reference model follows the command of a sample without control. */
ARS_SECTION_CODE void ars_law_rest(
    ars_law_t *self, const ars_measurement_t *sample, float friction, float rear_angle)
{
    const ars_reference_model_input_t input
        = { sample->speed, sample->front_angle, rear_angle, friction };

    ars_reference_model_step(&self->model, &input);
}
