/*
 * Control law, kind "pi". See ars_law.h.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_law.h"

#include "ars_map.h"
#include "ars_sections.h"

#if ARS_LAW_BUILD != 0x76CDF87Cu
#error "ars_law.h and this source come from different builds"
#endif
#if ARS_MAP_BUILD != 0x76CDF87Cu
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

/* Control law "pi": rear_angle = -(Kp error + Ki integral of error). The integral is stored as a rear angle in rad, with its sign. */

ARS_SECTION_CODE void ars_law_init(ars_law_t *self, float rear_angle)
{
    self->integral = rear_angle;
    self->is_limited = false;
}

/* Demand within the angle limit and the allowed distance to the measured angle: a stuck or slow actuator must not wind up the
 * integral. */
ARS_SECTION_CODE static float allowed(
    const ars_parameters_t *parameters, const ars_measurement_t *sample, float demand)
{
    const float lead_max = parameters->rear_angle_error_max;
    const float reachable_demand = clamp(demand, sample->rear_angle - lead_max, sample->rear_angle + lead_max);

    return bounded(reachable_demand, parameters->rear_angle_max);
}

ARS_SECTION_CODE ars_law_output_t ars_law_step(
    ars_law_t *self, const ars_parameters_t *parameters, const ars_measurement_t *sample, ars_law_phase_t phase,
    float friction, float rear_angle, float yaw_rate_error)
{
    const float reference = ars_map_yaw_rate_on_road(sample->speed, sample->front_angle, friction);
    const float error = reference - sample->yaw_rate;
    const float proportional = parameters->proportional_gain * error;
    const float command_step_max = command_step(parameters);
    /* Bumpless start: with this integral the first demand is the present command. */
    const float previous_integral = (phase == ARS_LAW_STARTS) ? (rear_angle + proportional) : self->integral;
    float integral = previous_integral;
    float rear_angle_demand;
    float bounded_demand;
    ars_law_output_t output;
    bool limited;

    (void)yaw_rate_error; /* the state of the integral is enough for a prediction */
    output.yaw_rate_reference = reference;
    if (!sample->inhibit) {
        integral -= (parameters->integral_gain * sampling_time) * error;
    }
    rear_angle_demand = integral - proportional;
    bounded_demand = allowed(parameters, sample, rear_angle_demand);
    limited = (bounded_demand > rear_angle_demand) || (bounded_demand < rear_angle_demand);
    if (limited && !sample->inhibit) {
        integral = bounded_demand + proportional; /* anti-windup: the integral that gives exactly the limit */
    }
    /* Anti-windup: at the rate limit the integral must not move further ahead of the command. */
    if (bounded_demand > (rear_angle + command_step_max)) {
        output.rear_angle = rear_angle + command_step_max;
        limited = true;
        integral = (integral > previous_integral) ? previous_integral : integral;
    } else if (bounded_demand < (rear_angle - command_step_max)) {
        output.rear_angle = rear_angle - command_step_max;
        limited = true;
        integral = (integral < previous_integral) ? previous_integral : integral;
    } else {
        output.rear_angle = bounded_demand;
    }
    self->integral = integral;
    self->is_limited = limited;
    return output;
}
