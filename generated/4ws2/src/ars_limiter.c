/*
 * Safety limiter of the rear angle. See ars_limiter.h.
 *
 * Order of a step: take the available inputs, find the range of the angle, limit demand and rate, bound the angle.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_limiter.h"

#include "ars_sections.h"

#if ARS_LIMITER_BUILD != 0xC9A75925u
#error "ars_limiter.h and this source come from different builds"
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

/* Return whether the value is within +-largest; false for NaN. */
ARS_SECTION_CODE static bool is_within(float value, float largest)
{
    return magnitude(value) <= largest;
}

/* Return whether the value is between low and high; false for NaN. */
ARS_SECTION_CODE static bool is_between(float value, float low, float high)
{
    return (value >= low) && (value <= high);
}

/* Bound of the opposite-phase angle: linear between the breakpoints, constant beyond them. */
ARS_SECTION_CODE static float opposite_phase_bound(const ars_limiter_parameters_t *parameters, float speed)
{
    const float *const breakpoints = parameters->opposite_phase_speed;
    float bound = parameters->opposite_phase_max[0];
    uint32_t k;

    for (k = 1u; k < (uint32_t)ARS_LIMITER_POINTS; k++) {
        const float next = parameters->opposite_phase_max[k];

        if (speed < breakpoints[k]) {
            if (speed > breakpoints[k - 1u]) {
                bound += ((speed - breakpoints[k - 1u]) / (breakpoints[k] - breakpoints[k - 1u])) * (next - bound);
            }
            break;
        }
        bound = next;
    }
    return bound;
}

ARS_SECTION_CODE bool ars_limiter_parameters_valid(const ars_limiter_parameters_t *parameters)
{
    bool valid = is_between(parameters->rear_angle_max, 1.0e-04f, 1.0f)
        && is_between(parameters->rear_rate_max, 0.017453292f, 1000.0f)
        && is_between(parameters->in_phase_from_front_angle, 1.0e-04f, 1.0f)
        && is_between(parameters->speed_max, 1.0f, 200.0f)
        && is_between(parameters->front_angle_max, 0.01f, 1.5f);
    uint32_t k;

    for (k = 0u; k < (uint32_t)ARS_LIMITER_POINTS; k++) {
        valid = valid && is_between(parameters->opposite_phase_speed[k], 0.0f, 200.0f);
        valid = valid && is_between(parameters->opposite_phase_max[k], 0.0f, 1.0f);
        valid = valid && (parameters->opposite_phase_max[k] <= parameters->rear_angle_max);
        valid = valid && ((k == 0u) || (parameters->opposite_phase_speed[k - 1u] < parameters->opposite_phase_speed[k]));
    }
    return valid;
}

ARS_SECTION_CODE void ars_limiter_init(ars_limiter_t *self, float rear_angle)
{
    self->rear_angle = is_between(rear_angle, -1.0f, 1.0f) ? rear_angle : 0.0f;
    self->speed = 0.0f;
    self->front_angle = 0.0f;
    self->speed_known = false;
}

ARS_SECTION_CODE float ars_limiter_step(
    ars_limiter_t *self, const ars_limiter_parameters_t *parameters, const ars_limiter_input_t *input)
{
    const float angle_step_max = parameters->rear_rate_max * sampling_time;
    const float demand = input->demand;
    float limited_demand = self->rear_angle;

    if (is_within(input->speed, parameters->speed_max)) {
        self->speed = magnitude(input->speed);
        self->speed_known = true;
    }
    if (is_within(input->front_angle, parameters->front_angle_max)) {
        self->front_angle = input->front_angle;
    }
    if (self->speed_known) {
        const float opposite_phase_max = opposite_phase_bound(parameters, self->speed);
        const float front_angle_ratio = magnitude(self->front_angle) / parameters->in_phase_from_front_angle;
        const float in_phase_share = (front_angle_ratio < 1.0f) ? front_angle_ratio : 1.0f;
        const float in_phase_max = opposite_phase_max + (in_phase_share * (parameters->rear_angle_max - opposite_phase_max));
        const float low = (self->front_angle < 0.0f) ? -in_phase_max : -opposite_phase_max;
        const float high = (self->front_angle > 0.0f) ? in_phase_max : opposite_phase_max;

        if (demand > high) {
            limited_demand = high;
        } else if (demand >= low) {
            limited_demand = demand;
        } else if (demand < low) {
            limited_demand = low;
        } else {
            limited_demand = clamp(limited_demand, low, high); /* NaN: the last angle */
        }
    }
    limited_demand = clamp(limited_demand, self->rear_angle - angle_step_max, self->rear_angle + angle_step_max);
    self->rear_angle = bounded(limited_demand, parameters->rear_angle_max);
    return self->rear_angle;
}
