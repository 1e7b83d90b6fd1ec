/*
 * Grip of the road, learned from what the car reaches. See ars_grip.h.
 *
 * Map 4ws2: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_grip.h"

#include "ars_constants.h"
#include "ars_sections.h"

#if ARS_CONSTANTS_BUILD != 0xC9A75925u
#error "ars_constants.h and this source come from different builds"
#endif
#if ARS_GRIP_BUILD != 0xC9A75925u
#error "ars_grip.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

ARS_SECTION_CONST static const float sampling_time = 0.01f; /* s */

/* Factor on a given estimate: it only brings the demand near the limit of the road; the learned grip does the rest. */
ARS_SECTION_CONST static const float estimate_factor = 1.25f;

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

ARS_SECTION_CODE void ars_grip_init(ars_grip_t *self)
{
    self->reached = 0.0f;
    self->available = ars_constants.grip_max;
}

ARS_SECTION_CODE float ars_grip_friction(
    const ars_grip_t *self, const ars_parameters_t *parameters, float estimate)
{
    const float bounded_estimate = estimate_factor * ((estimate < parameters->friction_min) ? parameters->friction_min : estimate);
    const float grip_friction = self->available * ars_constants.friction_per_grip;

    return (bounded_estimate < grip_friction) ? bounded_estimate : grip_friction;
}

ARS_SECTION_CODE void ars_grip_update(
    ars_grip_t *self, const ars_parameters_t *parameters, float model_acceleration, float acceleration)
{
    const float demanded_acceleration = magnitude(model_acceleration);
    const float achieved_acceleration = (model_acceleration > 0.0f) ? acceleration : -acceleration;
    const float achieved_magnitude = magnitude(acceleration);
    const float decayed_maximum = self->reached - ((parameters->grip_forgetting * sampling_time) * self->reached);
    const float unused = 1.0f - (demanded_acceleration / self->available);
    const float tolerance = parameters->grip_shortfall
        + ((unused > 0.0f) ? ((parameters->grip_shortfall_share * demanded_acceleration) * unused) : 0.0f);
    const float excess = (demanded_acceleration - achieved_acceleration) - tolerance;
    float available = self->available;

    self->reached = (achieved_magnitude > decayed_maximum) ? achieved_magnitude : decayed_maximum;
    if ((achieved_acceleration > 0.0f) && (excess > 0.0f)) { /* not in a change of direction */
        available -= (parameters->grip_loss_rate * sampling_time) * excess;
    } else {
        /* A gentle turn gives no information on the road: recover from the last finding faster. */
        const float recovery
            = (demanded_acceleration < (0.5f * available)) ? parameters->grip_recovery_idle : parameters->grip_recovery;

        available += recovery * sampling_time;
    }
    if (available < self->reached) {
        available = self->reached;
    }
    self->available = clamp(available, parameters->friction_min / ars_constants.friction_per_grip, ars_constants.grip_max);
}

ARS_SECTION_CODE void ars_grip_recover(ars_grip_t *self, const ars_parameters_t *parameters)
{
    const float available = self->available + (parameters->grip_recovery_idle * sampling_time);

    self->reached -= (parameters->grip_forgetting * sampling_time) * self->reached;
    self->available = (available < ars_constants.grip_max) ? available : ars_constants.grip_max;
}
