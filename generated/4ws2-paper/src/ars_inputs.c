/*
 * Monitoring of the inputs. See ars_inputs.h.
 *
 * Order of a step: speed, front angle, the yaw rate that they make, yaw rate; then what is not believed is replaced.
 *
 * Map 4ws2-paper: road friction 0.9, 0 to 120 km/h, 0 to 35 deg at the front wheels.
 * Made by codegen 0.1.0; do not edit, build again. Inputs and hashes are in manifest.json.
 */
#include "ars_inputs.h"

#include "ars_sections.h"

#if ARS_INPUTS_BUILD != 0x4E569E35u
#error "ars_inputs.h and this source come from different builds"
#endif

/* NaN and infinity are inputs here; a compiler that may assume there are none would drop the checks. */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0))
#error "do not compile this file with -ffast-math or -ffinite-math-only"
#endif

/* More than any road's, and so that of a car which knows nothing of its road. */
ARS_SECTION_CONST static const float friction_unknown = 2.0f;

/* m/s: slower, a front angle makes as good as no yaw rate to find it by. */
ARS_SECTION_CONST static const float speed_least = 1.0f;

/* m/s: slower, the noise of a lateral acceleration is that of a turn. */
ARS_SECTION_CONST static const float lateral_speed_least = 5.0f;

/* The number without its sign bit: one instruction, where a comparison takes five. */
ARS_SECTION_CODE static float magnitude(float value)
{
    union {
        float value;
        uint32_t bits;
    } number = { .value = value };

    number.bits &= 0x7FFFFFFFu;
    return number.value;
}

/* False for NaN. */
ARS_SECTION_CODE static bool is_within(float value, float largest)
{
    return magnitude(value) <= largest;
}

/* False for NaN. */
ARS_SECTION_CODE static bool is_between(float value, float low, float high)
{
    return (value >= low) && (value <= high);
}

/* The value within +-largest. NaN counts as the bound: none stays in the state. */
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

/* A signal that was measured so far: it is missing, for a short time or for too long, or wrong where it moves by more than `step` in a
 * sample. Returns whether it is missing, for a short time so far. */
ARS_SECTION_CODE static bool follow(
    ars_signal_t *self, const ars_inputs_parameters_t *parameters, float measured, bool is_available, float step_max)
{
    bool is_missing = false;

    if (!is_available) {
        self->missing++;
        is_missing = self->missing <= parameters->missing_samples_max;
        if (!is_missing) {
            self->source = ARS_SIGNAL_LOST;
        }
    } else if (is_within(measured - self->value, step_max * ((float)self->missing + 1.0f))) {
        self->value = measured;
    } else {
        self->source = ARS_SIGNAL_WRONG;
    }
    return is_missing;
}

/* After a sample in which no signal is missing: were each count to fall alone, signals that are missing in turn would be predicted for
 * good. */
ARS_SECTION_CODE static void forget(ars_signal_t *self)
{
    if ((self->source == ARS_SIGNAL_MEASURED) && (self->missing > 0u)) {
        self->missing--;
    }
}

/* A signal that is replaced: it has to be there and, where it was wrong, to be confirmed by the others, for so many samples in a row. */
ARS_SECTION_CODE static void prove(
    ars_signal_t *self, const ars_inputs_parameters_t *parameters, float measured, bool is_available, bool is_confirmed)
{
    if (is_available && (is_confirmed || (self->source == ARS_SIGNAL_LOST))) {
        self->good++;
    } else {
        self->good = 0u;
    }
    if (self->good >= parameters->recovery_samples) {
        self->source = ARS_SIGNAL_MEASURED;
        self->value = measured;
        self->good = 0u;
        self->missing = 0u;
    }
}

/* A signal that stays to the bit while the yaw rate and that of the angles move apart. `least` is how near they were since it changed. */
ARS_SECTION_CODE static bool is_frozen(
    const ars_signal_t *self, const ars_inputs_parameters_t *parameters, float measured, float deviation, float *least_deviation)
{
    if ((deviation < *least_deviation) || (measured > self->value) || (measured < self->value)) {
        *least_deviation = deviation;
    }
    return (deviation - *least_deviation) > parameters->yaw_rate_frozen;
}

/* An estimate that is lost goes slowly to that of a road nobody knows. */
ARS_SECTION_CODE static void take_friction(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured)
{
    if (is_between(measured, 0.0f, parameters->friction_max)) {
        self->friction = measured;
    } else {
        const float recovered_friction = self->friction + parameters->friction_recovery;

        self->friction = (recovered_friction < friction_unknown) ? recovered_friction : friction_unknown;
    }
}

ARS_SECTION_CODE bool ars_inputs_parameters_valid(const ars_inputs_parameters_t *parameters)
{
    return is_between(parameters->speed_max, 13.888889f, 200.0f)
        && is_between(parameters->front_angle_max, 0.17453292f, 1.5f)
        && is_between(parameters->yaw_rate_max, 0.43633232f, 20.0f)
        && is_between(parameters->rear_angle_max, 0.0017453292f, 0.7853982f)
        && is_between(parameters->friction_max, 0.5f, 2.0f)
        && is_between(parameters->speed_step, 0.12f, 200.0f)
        && is_between(parameters->front_angle_step, 0.010471975f, 3.0f)
        && is_between(parameters->yaw_rate_step, 0.034906585f, 40.0f)
        && is_between(parameters->wheelbase, 1.57f, 6.28f)
        && is_between(parameters->understeer_coefficient, -0.0035713008f, 0.0035452303f)
        && is_between(parameters->expected_share, 0.001f, 1.0f)
        && is_between(parameters->yaw_rate_tolerance, 0.08726646f, 20.0f)
        && is_between(parameters->lateral_acceleration_max, 3.0f, 100.0f)
        && is_between(parameters->yaw_rate_frozen, 0.008726646f, 20.0f)
        && is_between(parameters->speed_agreement, 0.027777778f, 200.0f)
        && is_between(parameters->yaw_rate_agreement, 0.0017453292f, 0.17453292f)
        && is_between(parameters->straight_yaw_rate, 0.0f, 1.0f)
        && is_between(parameters->yaw_rate_offset_max, 0.0f, 1.0f)
        && is_between(parameters->yaw_rate_correction_share, 1.0e-06f, 1.0f)
        && is_between(parameters->speed_fall, 0.0f, 1.0f)
        && is_between(parameters->friction_recovery, 1.0e-05f, 1.0f)
        && (parameters->missing_samples_max <= 100u)
        && (parameters->recovery_samples >= 1u)
        && (parameters->recovery_samples <= 10000u);
}

ARS_SECTION_CODE static void signal_init(ars_signal_t *self, bool is_trusted)
{
    self->value = 0.0f;
    self->missing = 0u;
    self->good = is_trusted ? 10000u : 0u;
    self->source = ARS_SIGNAL_LOST;
}

ARS_SECTION_CODE void ars_inputs_init(ars_inputs_t *self, bool is_trusted)
{
    signal_init(&self->speed, is_trusted);
    signal_init(&self->front_angle, is_trusted);
    signal_init(&self->yaw_rate, is_trusted);
    self->expected_yaw_rate = 0.0f;
    self->least = 0.0f;
    self->least_of_front = 0.0f;
    self->yaw_rate_offset = 0.0f;
    self->beyond_linear = 0.0f;
    self->friction = friction_unknown;
    self->lateral_is_known = false;
    self->lateral_is_proven = false;
}

ARS_SECTION_CODE static ars_quality_t quality_of(const ars_inputs_t *self, bool has_missing)
{
    ars_quality_t quality = ARS_QUALITY_GOOD;

    if (self->front_angle.source != ARS_SIGNAL_MEASURED) {
        quality = (self->yaw_rate.source == ARS_SIGNAL_MEASURED) ? ARS_QUALITY_REPLACED : ARS_QUALITY_UNUSABLE;
    } else if ((self->yaw_rate.source != ARS_SIGNAL_MEASURED) || (self->speed.source != ARS_SIGNAL_MEASURED)) {
        quality = ARS_QUALITY_REPLACED;
    } else {
        /* good */
    }
    return (has_missing && (quality != ARS_QUALITY_UNUSABLE)) ? ARS_QUALITY_MISSING : quality;
}

/* rad/s of the linear car for each rad between front and rear wheels; that of a car beyond its critical speed is bounded. */
ARS_SECTION_CODE static float yaw_gain(const ars_inputs_parameters_t *parameters, float speed)
{
    const float length_min = 0.25f * parameters->wheelbase;
    const float effective_length = parameters->wheelbase + ((parameters->understeer_coefficient * speed) * speed);

    return speed / ((effective_length > length_min) ? effective_length : length_min);
}

/* Whether a yaw rate agrees with a turn that is one: that zero agrees with zero proves nothing. */
ARS_SECTION_CODE static bool agrees(const ars_inputs_parameters_t *parameters, float yaw_rate, float turn_yaw_rate)
{
    const float agreement = parameters->yaw_rate_agreement;

    return !is_within(turn_yaw_rate, agreement + agreement) && is_within(yaw_rate - turn_yaw_rate, agreement);
}

/* The turn that the lateral acceleration shows. */
typedef struct {
    float yaw_rate; /* rad/s */
    bool is_there;
    bool is_evidence; /* there, and it agreed with the yaw rate in the last turn */
} lateral_t;

ARS_SECTION_CODE static lateral_t turn_of_lateral(
    const ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured)
{
    lateral_t lateral = { 0.0f, false, false };

    if ((self->speed.value >= lateral_speed_least) && is_within(measured, parameters->lateral_acceleration_max)) {
        lateral.yaw_rate = measured / self->speed.value;
        lateral.is_there = true;
        lateral.is_evidence = self->lateral_is_proven;
    }
    return lateral;
}

/* Lateral acceleration over yaw rate is a speed, if the front angle makes that yaw rate at it: a tilted road moves the acceleration
 * alone. A measured speed is wrong where it is another one for five times as many samples as a wrong one has to be right; one that is
 * replaced slowly goes there. angle: rad, of front less rear wheels. */
ARS_SECTION_CODE static void check_speed(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float net_steering_angle, const lateral_t *lateral)
{
    ars_signal_t *const signal = &self->speed;
    const float yaw_rate = self->yaw_rate.value;
    const float implied_speed = (lateral->yaw_rate * signal->value) / yaw_rate;

    if (is_within((yaw_gain(parameters, implied_speed) * net_steering_angle) - yaw_rate, parameters->yaw_rate_agreement)) {
        const float speed_deviation = implied_speed - signal->value;

        if (signal->source != ARS_SIGNAL_MEASURED) {
            signal->value = bounded(signal->value + (parameters->yaw_rate_correction_share * speed_deviation), parameters->speed_max);
        } else if (!is_within(speed_deviation, parameters->speed_agreement)) {
            signal->good++;
            if (signal->good >= (5u * parameters->recovery_samples)) {
                signal->source = ARS_SIGNAL_WRONG;
                signal->value = bounded(implied_speed, parameters->speed_max);
                signal->good = 0u;
            }
        } else {
            signal->good = 0u;
        }
    }
}

/* In a turn. The lateral acceleration is proven where the yaw rate agrees with it, and refuted where that agrees with the front angle
 * and not with it; where the yaw rate agrees with none of them, the speed may be wrong. */
ARS_SECTION_CODE static void compare_with_lateral(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float net_steering_angle, const lateral_t *lateral)
{
    const float agreement = parameters->yaw_rate_agreement;
    const float yaw_rate = self->yaw_rate.value;
    const float yaw_rate_deviation = lateral->yaw_rate - yaw_rate;

    if (is_within(yaw_rate, agreement + agreement)) {
        /* no turn */
    } else if (is_within(yaw_rate_deviation, agreement)) {
        self->lateral_is_proven = true;
    } else if (!is_within(self->expected_yaw_rate - yaw_rate, agreement)) {
        if (lateral->is_evidence) {
            check_speed(self, parameters, net_steering_angle, lateral);
        }
    } else if (!is_within(yaw_rate_deviation, agreement + agreement) && (self->speed.source == ARS_SIGNAL_MEASURED)) {
        self->lateral_is_proven = false;
    } else {
        /* it shows nothing */
    }
}

/* A speed that was wrong is right again near what stands for it. That is held or falls slowly while the car may change its speed, so
 * near is a quarter of it more; and it says nothing once it is that of a car that stands. */
ARS_SECTION_CODE static bool is_right_again(const ars_inputs_parameters_t *parameters, float measured, float replacement)
{
    const float replacement_speed = magnitude(replacement);

    return (replacement_speed < speed_least) || is_within(measured - replacement, parameters->speed_agreement + (0.25f * replacement_speed));
}

/* Each takes one signal. Returns whether it is missing, for a short time so far. */
ARS_SECTION_CODE static bool take_speed(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured)
{
    ars_signal_t *const signal = &self->speed;
    const bool is_available = is_within(measured, parameters->speed_max);
    bool is_missing = false;

    if (signal->source == ARS_SIGNAL_MEASURED) {
        is_missing = follow(signal, parameters, measured, is_available, parameters->speed_step);
        signal->good = (signal->source == ARS_SIGNAL_MEASURED) ? signal->good : 0u;
    } else {
        prove(signal, parameters, measured, is_available, is_right_again(parameters, measured, signal->value));
    }
    if (signal->source != ARS_SIGNAL_MEASURED) {
        signal->value = toward_zero(signal->value, parameters->speed_fall);
    }
    return is_missing;
}

/* turn: rad/s that the front angle would make in the linear car. A car that leaves the linear range moves away from a front angle
 * that is held still, so yaw rate and lateral acceleration have to agree that it turns by less than half of that. */
ARS_SECTION_CODE static bool take_front_angle(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured, float front_yaw_rate, const lateral_t *lateral)
{
    ars_signal_t *const signal = &self->front_angle;
    const float yaw_rate = self->yaw_rate.value;
    const float expected_yaw_rate = self->expected_yaw_rate;
    const bool is_available = is_within(measured, parameters->front_angle_max);
    bool has_frozen = false;
    bool is_missing = false;

    if ((signal->source == ARS_SIGNAL_MEASURED) && (self->yaw_rate.source == ARS_SIGNAL_MEASURED)) {
        has_frozen = is_frozen(signal, parameters, measured, magnitude(yaw_rate - expected_yaw_rate), &self->least_of_front);
    } else {
        self->least_of_front = 2.0f * parameters->yaw_rate_max; /* that none is apart by */
    }
    if (signal->source != ARS_SIGNAL_MEASURED) {
        prove(signal, parameters, measured, is_available, agrees(parameters, front_yaw_rate, yaw_rate));
    } else {
        is_missing = follow(signal, parameters, measured, is_available, parameters->front_angle_step);
        if (is_available && has_frozen && lateral->is_evidence && ((yaw_rate * expected_yaw_rate) < (0.5f * (expected_yaw_rate * expected_yaw_rate)))
            && is_within(lateral->yaw_rate - yaw_rate, parameters->yaw_rate_agreement)) {
            signal->source = ARS_SIGNAL_WRONG;
        }
    }
    return is_missing;
}

/* A yaw rate may be as large as the road's grip lets it, and by a tolerance larger, for a car that spins. It is wrong where it froze,
 * or shows a turn to the other side than both angles and lateral acceleration, for as many samples as a wrong one has to be right.
 * angle: rad, of front less rear wheels. */
ARS_SECTION_CODE static bool take_yaw_rate(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float measured, float net_steering_angle, const lateral_t *lateral)
{
    ars_signal_t *const signal = &self->yaw_rate;
    const float speed = magnitude(self->speed.value);
    const float expected_yaw_rate = self->expected_yaw_rate;
    const float turn_yaw_rate_min = 2.0f * parameters->yaw_rate_agreement;
    const bool is_available = is_within(measured, parameters->yaw_rate_max)
        && is_within(speed * measured, parameters->lateral_acceleration_max + (speed * parameters->yaw_rate_tolerance));
    bool is_missing = false;

    if (signal->source != ARS_SIGNAL_MEASURED) {
        self->least = 2.0f * parameters->yaw_rate_max; /* that none is apart by */
        prove(signal, parameters, measured, is_available, agrees(parameters, measured, signal->value));
    } else if (is_available) {
        const bool has_frozen = is_frozen(signal, parameters, measured, magnitude(measured - expected_yaw_rate), &self->least);

        if (((measured * expected_yaw_rate) < 0.0f) && ((measured * lateral->yaw_rate) < 0.0f) && !is_within(measured, turn_yaw_rate_min)
            && !is_within(lateral->yaw_rate, turn_yaw_rate_min)) {
            signal->good++;
        } else {
            signal->good = 0u;
        }
        is_missing = follow(signal, parameters, measured, true, parameters->yaw_rate_step);
        if (has_frozen || (signal->good >= parameters->recovery_samples)) {
            signal->source = ARS_SIGNAL_WRONG;
        }
        if (signal->source != ARS_SIGNAL_MEASURED) {
            signal->good = 0u;
        } else if (lateral->is_there) {
            compare_with_lateral(self, parameters, net_steering_angle, lateral);
        } else {
            /* nothing more to ask */
        }
    } else {
        signal->good = 0u;
        is_missing = follow(signal, parameters, measured, false, parameters->yaw_rate_step);
    }
    return is_missing;
}

/* While the front wheels are straight, what the sensor shows beyond the linear car's turn is learned as its offset; of a turn that the
 * lateral acceleration shows too no more than is beyond that. */
ARS_SECTION_CODE static float without_offset(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, float front_yaw_rate, const lateral_t *lateral)
{
    if (is_within(front_yaw_rate, parameters->straight_yaw_rate) && (self->speed.value >= lateral_speed_least)
        && (lateral->is_there || !self->lateral_is_known)) {
        float offset_estimate = self->yaw_rate.value - self->expected_yaw_rate;

        if (lateral->is_there) {
            const float offset_bound = magnitude(self->yaw_rate.value - lateral->yaw_rate);

            offset_estimate = bounded(offset_estimate, offset_bound);
        }
        offset_estimate = self->yaw_rate_offset + (parameters->yaw_rate_correction_share * (offset_estimate - self->yaw_rate_offset));
        self->yaw_rate_offset = bounded(offset_estimate, parameters->yaw_rate_offset_max);
    }
    return bounded(self->yaw_rate.value - self->yaw_rate_offset, parameters->yaw_rate_max);
}

/* For the yaw rate: fast the linear car's, slowly that of a lateral acceleration. Fed back at once, that one swings. */
ARS_SECTION_CODE static void stand_in(ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const lateral_t *lateral)
{
    float correction = 0.0f;

    if (lateral->is_evidence) {
        correction = lateral->yaw_rate - self->expected_yaw_rate;
    }
    correction = self->beyond_linear + (parameters->yaw_rate_correction_share * (correction - self->beyond_linear));
    self->beyond_linear = bounded(correction, parameters->yaw_rate_max);
    self->yaw_rate.value = bounded(self->expected_yaw_rate + self->beyond_linear, parameters->yaw_rate_max);
}

ARS_SECTION_CODE ars_quality_t ars_inputs_step(
    ars_inputs_t *self, const ars_inputs_parameters_t *parameters, const ars_measurement_t *measured, float rear_angle,
    ars_measurement_t *believed)
{
    const float believed_rear_angle
        = is_within(measured->rear_angle, parameters->rear_angle_max) ? measured->rear_angle : rear_angle;
    bool has_missing = take_speed(self, parameters, measured->speed);
    const float gain = yaw_gain(parameters, self->speed.value);
    const lateral_t lateral = turn_of_lateral(self, parameters, measured->lateral_acceleration);
    float linear_yaw_rate = gain * (measured->front_angle - believed_rear_angle);
    float net_steering_angle;

    self->lateral_is_known = self->lateral_is_known || lateral.is_there;
    has_missing = take_front_angle(self, parameters, measured->front_angle, linear_yaw_rate, &lateral) || has_missing;
    net_steering_angle = self->front_angle.value - believed_rear_angle;
    linear_yaw_rate = self->expected_yaw_rate + (parameters->expected_share * ((gain * net_steering_angle) - self->expected_yaw_rate));
    self->expected_yaw_rate = bounded(linear_yaw_rate, parameters->yaw_rate_max);
    has_missing = take_yaw_rate(self, parameters, measured->yaw_rate, net_steering_angle, &lateral) || has_missing;
    if ((self->front_angle.source == ARS_SIGNAL_WRONG) && (self->yaw_rate.source == ARS_SIGNAL_WRONG)) {
        self->front_angle.source = ARS_SIGNAL_LOST; /* none is left to confirm the other */
        self->yaw_rate.source = ARS_SIGNAL_LOST;
    }
    if (self->yaw_rate.source != ARS_SIGNAL_MEASURED) {
        stand_in(self, parameters, &lateral);
    } else if ((self->front_angle.source != ARS_SIGNAL_MEASURED) && (self->speed.value >= speed_least)) {
        self->front_angle.value = bounded(believed_rear_angle + (self->yaw_rate.value / gain), parameters->front_angle_max);
    } else {
        /* both are measured, or the car stands */
    }
    if (!has_missing) {
        forget(&self->speed);
        forget(&self->front_angle);
        forget(&self->yaw_rate);
    }
    take_friction(self, parameters, measured->friction);
    believed->speed = self->speed.value;
    believed->front_angle = self->front_angle.value;
    believed->yaw_rate = self->yaw_rate.value;
    if (self->yaw_rate.source == ARS_SIGNAL_MEASURED) {
        self->beyond_linear = 0.0f;
        believed->yaw_rate = without_offset(self, parameters, gain * self->front_angle.value, &lateral);
    }
    believed->rear_angle = believed_rear_angle;
    believed->friction = self->friction;
    believed->lateral_acceleration = believed->speed * (lateral.is_there ? lateral.yaw_rate : believed->yaw_rate);
    believed->inhibit = measured->inhibit;
    return quality_of(self, has_missing);
}
